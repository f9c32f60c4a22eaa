"""Pictures as shapes, and the painter of shapes with OpenCV.

`canvas.py` has the kinds of shapes; `scene_shapes.py` and `road_shapes.py` make those of a scene, a tick and the roads.
Each medium has one painter that knows shapes and nothing of a scene: `paint.py` (PNG, GIF, MP4, WebP, sheets, pictures
of training), `report.page.page_format` (HTML pages), `bridges.mcap_recording` (MCAP).
"""
