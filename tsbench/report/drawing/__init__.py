"""What pictures show, as shapes, and how OpenCV paints them.

`shapes.py` has the kinds of shapes; `scene.py` and `roads.py` say of which a scene, a tick and its roads consist.
Each medium has one painter that knows shapes and nothing of a scene: `paint.py` (PNG, GIF, MP4, WebP, sheets, pictures
of training), `report.page.drawing` (HTML pages), `report.export.shapes` (MCAP).
"""
