"""Self-contained HTML pages: one file with its styles, scripts and data in it, opened from disk without a network.

What a page is made of, and how another page uses it:

`shell.render_page("mine.html", data=..., blobs=..., scripts=..., title=...)` renders a template of `templates/` that
extends `base.html` (blocks `home`, `nav`, `content`; macros in `parts.html`). Everything that a template prints is
escaped; SVG goes in as `markupsafe.Markup`, and only where tsbench itself drew it.

* `data`: small JSON values, read in the page with `tsb.json(name)`.
* `blobs`: bytes of `packing.pack`, read with `await tsb.blob(name)`: header and typed arrays. They are compressed; a
  page may hold thousands, for none is unpacked before it is asked for.
* `scripts`: files of `static/` that come after `core.js` (elements, themes, data), `table.js` and `bev.js`:
    - `tsb.table(host, table, {open})` is a table with filters, sorting and "show more" (format: `table.js`; in Python
      `packing.pack_table`).
    - `new tsb.Bev(canvas)` is a bird's-eye view that knows no run: `addPlates(svgs)`, `show([drawing, ...])`,
      `fit(box)`, `follow(x, y)`, `draw(moving)`. `drawing.drawing(shapes)` makes a drawing of what
      `report.roads` and `report.drawing.scene` yield, or of shapes of one's own; `drawing.plates_of` gives the plates.
      Units: m in the network's frame, rad.
* colours and sizes are in `static/base.css` for light and dark; those of bird's-eye views come from `report.style`.
* `charts.inline_svg(figure)` turns a Matplotlib figure into inline SVG that takes the page's colours.

A page that is served (`server.py`) gets the same blobs by HTTP: `tsb.blob` fetches what the page does not hold from the
address in `data["source"]`.
"""
