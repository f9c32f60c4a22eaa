/* A bird's-eye view on a canvas. It knows roads, plates and bodies, and nothing of a run.
 *
 * A drawing (page_format.py) is {unit, x0, y0, areas, lines, plates, bodies}:
 *   areas: [{c: colour, a: opacity, r: [ring, …]}], lines: [{c, w: metres, p: [line, …]}]; rings and lines are flat lists
 *   of whole numbers, the first point from (x0, y0), each other from the one before, in `unit` metres;
 *   plates: [{x, y, ax, ay, clear, plate, below, target}] in metres: post, unit vector off the road in the picture,
 *   distance to the kerb, keys of the plate and of one beneath it ("" = none); bodies: [{x, y, h, l, w, c}], c being a kind of bodies;
 *   of those that move also signals (1: the left side flashes, -1: the right one) and brakes (are their lights on?).
 * Colours are names of report/drawing/canvas.py: CSS variables --bev-NAME. North is up. */
tsb.Bev = class {
  static KINDS = ["car", "bus", "bicycle", "pedestrian", "convoy", "ego"];

  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.camera = { x: 0, y: 0, scale: 6 };
    this.drawings = [];
    this.plates = new Map();
    this.moving = null;
    this.redraw = () => { cancelAnimationFrame(this.frame); this.frame = requestAnimationFrame(() => this.paint()); };
    this.onmove = null; // called when a user moves the camera
    this.onzoom = null; // called when the camera's scale has changed
    new ResizeObserver(() => this.resize()).observe(canvas);
    tsb.themed.add(() => { this.colours = null; this.redraw(); });
    this.gestures();
    this.resize();
  }

  /* Plates by key, as SVG documents. */
  addPlates(svgs) {
    for (const [key, svg] of Object.entries(svgs)) {
      if (this.plates.has(key)) continue;
      const image = new Image();
      image.addEventListener("load", this.redraw);
      image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(svg);
      this.plates.set(key, image);
    }
  }

  /* The drawings from now on, lowest first. */
  show(drawings) {
    const path = (drawing, lists, closed) => {
      const found = new Path2D();
      for (const list of lists) {
        let x = 0, y = 0;
        for (let k = 0; k < list.length; k += 2) {
          x += list[k]; y += list[k + 1];
          found[k ? "lineTo" : "moveTo"](drawing.x0 + x * drawing.unit, drawing.y0 + y * drawing.unit);
        }
        if (closed) found.closePath();
      }
      return found;
    };
    this.drawings = drawings.filter(Boolean).map((drawing) => ({
      ...drawing,
      areas: (drawing.areas || []).map((area) => ({ ...area, path: path(drawing, area.r, true) })),
      lines: (drawing.lines || []).map((line) => ({ ...line, path: path(drawing, line.p, false) })),
    }));
    this.redraw();
  }

  /* Show a box [left, bottom, right, top] of the network's metres, with room around it. */
  fit([left, bottom, right, top], room = 8) {
    const width = right - left + 2 * room, height = top - bottom + 2 * room;
    this.camera = { x: (left + right) / 2, y: (bottom + top) / 2,
      scale: Math.min(this.width / width, this.height / height, 14) };
    this.redraw();
  }

  follow(x, y) { this.camera.x = x; this.camera.y = y; }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(Math.max(this.camera.scale * factor, 0.3), 40);
    const share = 1 / this.camera.scale - 1 / scale;
    this.camera.x += (px - this.width / 2) * share;
    this.camera.y -= (py - this.height / 2) * share;
    this.camera.scale = scale;
    this.onzoom?.();
    this.redraw();
  }

  /* What moves: {bodies: as in a drawing, lines: [{c, w, points: flat metres, dash}], marks: [{x, y, h}], labels: [{name, x, y, left}]}. */
  draw(moving) { this.moving = moving; this.redraw(); }

  resize() {
    tsb.sizeCanvas(this);
    this.onresize?.();
    this.redraw();
  }

  gestures() {
    const fingers = new Map();
    const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const wide = fingers.size === 2 ? spread() : 0;
      fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      if (wide) this.zoom(spread() / wide);
      this.camera.x -= (event.offsetX - before.x) / this.camera.scale / fingers.size;
      this.camera.y += (event.offsetY - before.y) / this.camera.scale / fingers.size;
      this.onmove?.();
      this.redraw();
    });
    const gone = (event) => fingers.delete(event.pointerId);
    this.canvas.addEventListener("pointerup", gone);
    this.canvas.addEventListener("pointercancel", gone);
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  colour(name) {
    if (!this.colours) { this.colours = {}; this.sheet = getComputedStyle(this.canvas); }
    return (this.colours[name] ??= this.sheet.getPropertyValue(`--bev-${name}`).trim() || "magenta");
  }

  paint() {
    const { context: c, camera } = this;
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.fillStyle = this.colour("ground");
    c.fillRect(0, 0, this.width, this.height);
    const s = this.ratio * camera.scale;
    const world = () => c.setTransform(s, 0, 0, -s,
      this.ratio * this.width / 2 - s * camera.x, this.ratio * this.height / 2 + s * camera.y);
    world();
    c.lineJoin = "round";
    for (const drawing of this.drawings) {
      for (const area of drawing.areas) {
        c.globalAlpha = area.a ?? 1;
        c.fillStyle = this.colour(area.c);
        c.fill(area.path, "evenodd");
      }
      c.globalAlpha = 1;
      c.lineCap = "butt";
      for (const line of drawing.lines) {
        c.globalAlpha = line.a ?? 1;
        c.strokeStyle = this.colour(line.c);
        c.lineWidth = Math.max(line.w, (line.min ?? 0.6) / camera.scale);
        c.stroke(line.path);
      }
      c.globalAlpha = 1;
    }
    for (const line of this.moving?.lines || []) {
      c.strokeStyle = this.colour(line.c);
      c.lineWidth = Math.max(line.w, 2 / camera.scale);
      c.lineCap = "round";
      c.setLineDash(line.dash || []);
      c.beginPath();
      for (let k = 0; k + 1 < line.points.length; k += 2) c[k ? "lineTo" : "moveTo"](line.points[k], line.points[k + 1]);
      c.stroke();
    }
    c.setLineDash([]);
    for (const drawing of this.drawings) for (const body of drawing.bodies || []) this.body(body);
    for (const mark of this.moving?.marks || []) this.mark(mark);
    for (const body of this.moving?.bodies || []) this.body(body);
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.placePlates();
    for (const one of this.moving?.labels || []) this.label(one);
    this.scaleBar();
  }

  body({ x, y, h, l, w, c: kind, signals = 0, brakes = false }) {
    const { context: c, camera } = this, edge = 1 / camera.scale;
    if (kind === "pedestrian" || kind === "bicycle") { this.person({ x, y, h, l, kind }); return; }
    if (kind === "cone") {
      c.beginPath();
      c.arc(x, y, Math.max(0.35, 3.5 / camera.scale), 0, 7);
      c.fillStyle = this.colour(kind);
      c.fill();
      c.strokeStyle = this.colour("outline");
      c.lineWidth = edge;
      c.stroke();
      return;
    }
    const cos = Math.cos(h), sin = Math.sin(h);
    const at = (u, v) => [x + u * l * cos - v * w * sin, y + u * l * sin + v * w * cos];
    const outline = (points) => {
      c.beginPath();
      points.forEach(([u, v], k) => c[k ? "lineTo" : "moveTo"](...at(u, v)));
      c.closePath();
    };
    const half = kind === "island" ? [[0.5, 0.5], [-0.5, 0.5]]
      : [[0.5, 0.28], [0.44, 0.44], [0.3, 0.5], [-0.44, 0.5], [-0.5, 0.4]];
    outline([...half, ...half.map(([u, v]) => [u, -v]).reverse()]);
    c.fillStyle = this.colour(kind);
    c.fill();
    c.strokeStyle = this.colour(kind === "island" ? "violation" : "outline");
    c.lineWidth = edge;
    c.stroke();
    if (kind === "island") return;
    outline([[0.26, 0.4], [0.1, 0.33], [0.1, -0.33], [0.26, -0.4]]);
    c.fillStyle = this.colour("glass");
    c.fill();
    const lamp = (u, v, colour) => {
      c.beginPath();
      c.arc(...at(u, v), Math.max(0.22, 2 / camera.scale), 0, 7);
      c.fillStyle = this.colour(colour);
      c.fill();
    };
    if (brakes) for (const side of [0.4, -0.4]) lamp(-0.46, side, "brake");
    if (signals) for (const end of [0.46, -0.46]) lamp(end, 0.4 * signals, "lamp");
  }

  /* The name of somebody, beside it, legible on any ground. */
  label({ x, y, name, left = false }) {
    const { context: c } = this, [px, py] = this.px(x, y);
    c.font = "13px system-ui, sans-serif";
    c.textAlign = "left";
    const width = c.measureText(name).width, from = left ? px - 14 - width : px + 14;
    c.fillStyle = this.colour("panel"); c.fillRect(from - 4, py - 34, width + 8, 19);
    c.fillStyle = this.colour("ink"); c.fillText(name, from, py - 20);
  }

  /* Somebody on foot, shoulders across the heading, or on a bicycle: two wheels in a line and a handlebar. */
  person({ x, y, h, l, kind }) {
    const { context: c, camera } = this, cos = Math.cos(h), sin = Math.sin(h);
    const at = (u, v) => [x + u * cos - v * sin, y + u * sin + v * cos];
    const stroke = (from, to, width, colour) => {
      c.beginPath(); c.moveTo(...at(...from)); c.lineTo(...at(...to));
      c.lineCap = "round"; c.lineWidth = width; c.strokeStyle = this.colour(colour); c.stroke();
    };
    const r = Math.max(0.35, 3.5 / camera.scale);
    if (kind === "bicycle") {
      stroke([-l / 2, 0], [l / 2, 0], Math.max(0.16, 1.5 / camera.scale), "outline");
      stroke([l / 4, 0.8 * r], [l / 4, -0.8 * r], Math.max(0.16, 1.5 / camera.scale), "outline");
    } else {
      stroke([0, r], [0, -r], 1.2 * r, "outline");
      stroke([0, r], [0, -r], 0.9 * r, kind);
    }
    c.beginPath();
    c.arc(x, y, 0.8 * r, 0, 7);
    c.fillStyle = this.colour(kind); c.fill();
    c.strokeStyle = this.colour("outline"); c.lineWidth = 1 / camera.scale; c.stroke();
  }

  /* A ring with a cross where something went wrong. */
  mark({ x, y }) {
    const { context: c, camera } = this, r = Math.max(4, 12 / camera.scale);
    c.beginPath();
    c.arc(x, y, r, 0, 7);
    c.moveTo(x - 0.35 * r, y - 0.35 * r); c.lineTo(x + 0.35 * r, y + 0.35 * r);
    c.moveTo(x - 0.35 * r, y + 0.35 * r); c.lineTo(x + 0.35 * r, y - 0.35 * r);
    c.strokeStyle = this.colour("marking"); c.lineWidth = 5 / camera.scale; c.stroke();
    c.strokeStyle = this.colour("violation"); c.lineWidth = 3 / camera.scale; c.stroke();
  }

  px(x, y) {
    return [this.width / 2 + (x - this.camera.x) * this.camera.scale, this.height / 2 - (y - this.camera.y) * this.camera.scale];
  }

  /* Every plate upright beside its post, away from the lane that it faces; targets first, with a frame. */
  placePlates() {
    const { context: c } = this, size = Math.min(Math.max(4.5 * this.camera.scale, 26), 60), placed = [];
    const plates = this.drawings.flatMap((drawing) => drawing.plates || []).sort((a, b) => Boolean(b.target) - Boolean(a.target));
    for (const plate of plates) {
      const [px, py] = this.px(plate.x, plate.y), off = size / 2 + 4 + plate.clear * this.camera.scale;
      // What hangs beneath is not to cover the road.
      let x = px + plate.ax * off, y = py + plate.ay * off - (plate.below && plate.ay < 0 ? 0.75 * size + 4 : 0);
      while (placed.some(([a, b]) => Math.abs(a - x) < size && Math.abs(b - y) < size)) {
        x += plate.ax * size / 2; y += plate.ay * size / 2;
      }
      placed.push([x, y]);
      c.strokeStyle = c.fillStyle = this.colour("outline");
      c.lineWidth = 2;
      c.beginPath(); c.moveTo(px, py); c.lineTo(x, y); c.stroke();
      c.beginPath(); c.arc(px, py, 3, 0, 7); c.fill();
      if (plate.target) {
        c.fillStyle = this.colour("marking"); c.strokeStyle = this.colour("plate_line"); c.lineWidth = 3;
        c.fillRect(x - size / 2 - 3, y - size / 2 - 3, size + 6, size + 6);
        c.strokeRect(x - size / 2 - 3, y - size / 2 - 3, size + 6, size + 6);
      }
      const image = this.plates.get(plate.plate);
      if (image?.complete && image.naturalWidth) c.drawImage(image, x - size / 2, y - size / 2, size, size);
      const below = this.plates.get(plate.below), small = 0.75 * size;
      if (below?.complete && below.naturalWidth) c.drawImage(below, x - small / 2, y + size / 2 + (plate.target ? 4 : 0), small, small);
    }
  }

  scaleBar() {
    const { context: c } = this;
    const metres = [200, 100, 50, 20, 10, 5, 2].find((m) => m * this.camera.scale <= this.width / 4) ?? 1;
    const y = this.height - 14;
    c.fillStyle = this.colour("marking"); c.fillRect(10, y - 1, metres * this.camera.scale + 4, 6);
    c.fillStyle = this.colour("outline"); c.fillRect(12, y, metres * this.camera.scale, 4);
    c.font = "12px system-ui, sans-serif";
    c.textAlign = "left";
    c.lineWidth = 3; c.strokeStyle = this.colour("marking"); c.strokeText(`${metres} m`, 12, y - 6);
    c.fillStyle = this.colour("outline"); c.fillText(`${metres} m`, 12, y - 6);
    const whose = "© OpenStreetMap contributors";
    c.textAlign = "right"; c.font = "11px system-ui, sans-serif";
    c.strokeText(whose, this.width - 8, this.height - 8); c.fillText(whose, this.width - 8, this.height - 8);
  }
};
