"""Self-contained HTML pages: one file with its styles, scripts and data in it, opened from disk without a network.

`page_format.render_page("mine.html", data=..., blobs=..., scripts=..., title=...)` renders a template of `templates/`
that extends `base.html` (blocks `home`, `nav`, `content`; macros in `parts.html`). Everything that a template prints is
escaped; SVG goes in as `markupsafe.Markup`, and only where tsbench itself drew it.

* `data`: small JSON values, read with `tsb.json(name)`. `blobs`: bytes of `page_format.pack`, read with
  `await tsb.blob(name)`, unpacked only when asked for; a served page (`report_server.py`) fetches those that it does
  not hold from the address in `data["source"]`.
* `scripts`: files of `static/` after `core.js`, `table.js` (`tsb.table`, tables of `page_format.pack_table`) and
  `bev.js` (`tsb.Bev`, a bird's-eye view of what `page_format.drawing` makes of shapes; m in the network's frame, rad).
* colours and sizes are in `static/base.css` for light and dark; those of bird's-eye views in `drawing/canvas.py`.
"""
