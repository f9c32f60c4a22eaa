"use strict";
/* The places of all maps as dots. blob `places`: see dataset_map.py. Events: onpick(place) when a used map is chosen. */
tsb.PlaceMap = class {
  constructor(canvas, places, onpick) {
    Object.assign(this, { canvas, places, onpick, type: "", chosen: null });
    this.context = canvas.getContext("2d");
    this.redraw = () => { cancelAnimationFrame(this.frame); this.frame = requestAnimationFrame(() => this.paint()); };
    this.whole();
    new ResizeObserver(() => this.resize()).observe(canvas);
    tsb.themed.add(this.redraw);
    this.gestures();
    this.resize();
  }

  /* All used maps; the pool reaches farther. */
  whole() {
    const xs = this.places.used.map((place) => place.x), ys = this.places.used.map((place) => place.y);
    this.box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    this.zoomed = false;
    if (this.width) this.fit();
  }

  fit() {
    const [left, bottom, right, top] = this.box, room = 70;
    this.scale = Math.min((this.width - room) / Math.max(right - left, 1), (this.height - room) / Math.max(top - bottom, 1));
    this.x = (left + right) / 2;
    this.y = (bottom + top) / 2;
    this.redraw();
  }

  resize() {
    tsb.sizeCanvas(this);
    if (!this.zoomed) this.fit();
    this.redraw();
  }

  px(x, y) { return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale]; }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(Math.max(this.scale * factor, 0.002), 4), share = 1 / this.scale - 1 / scale;
    this.x += (px - this.width / 2) * share;
    this.y -= (py - this.height / 2) * share;
    this.scale = scale;
    this.zoomed = true;
    this.redraw();
  }

  gestures() {
    let from = null, moved = 0;
    this.canvas.addEventListener("pointerdown", (event) => {
      from = { x: event.offsetX, y: event.offsetY };
      moved = 0;
      if (event.pointerType === "mouse") this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      const dx = event.offsetX - from.x, dy = event.offsetY - from.y;
      moved += Math.abs(dx) + Math.abs(dy);
      if (moved < 6) return;
      from = { x: event.offsetX, y: event.offsetY };
      this.x -= dx / this.scale;
      this.y += dy / this.scale;
      this.zoomed = true;
      this.redraw();
    });
    this.canvas.addEventListener("pointerup", (event) => {
      if (from && moved < 6) this.pick(event.offsetX, event.offsetY);
      from = null;
    });
    this.canvas.addEventListener("pointercancel", () => { from = null; });
    // Without ctrl the wheel scrolls the page, as it does everywhere else.
    this.canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 300), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  wanted(place) { return !this.type || place.types.includes(this.type); }

  pick(px, py) {
    let best = null, nearest = 18;
    for (const place of this.places.used.filter((p) => this.wanted(p))) {
      const [x, y] = this.px(place.x, place.y), away = Math.hypot(x - px, y - py);
      if (away < nearest) { best = place; nearest = away; }
    }
    this.chosen = best;
    this.onpick(best);
    this.redraw();
  }

  paint() {
    const { context: c, places } = this, { x: xs, y: ys } = places.array;
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    const metres = this.scale / places.unit, size = Math.min(Math.max(0.9 + 60 * metres, 1), 4);
    c.fillStyle = tsb.colour("--faint");
    c.globalAlpha = 0.4;
    for (let k = 0; k < xs.length; k++) {
      const [x, y] = this.px(xs[k], ys[k]);
      if (x > -4 && y > -4 && x < this.width + 4 && y < this.height + 4) c.fillRect(x - size / 2, y - size / 2, size, size);
    }
    const r = Math.min(Math.max(2.2 + 60 * metres, 2.4), 7);
    const colours = { test: tsb.colour("--group-speed"), train: tsb.colour("--group-priority"),
      dev: tsb.colour("--group-routing"), holdout: tsb.colour("--group-obstacles") };
    for (const split of ["train", "holdout", "test", "dev"]) {
      c.fillStyle = colours[split];
      for (const place of places.used) {
        if (place.split !== split) continue;
        c.globalAlpha = this.wanted(place) ? 0.9 : 0.07;
        const [x, y] = this.px(place.x, place.y);
        c.beginPath(); c.arc(x, y, r, 0, 7); c.fill();
      }
    }
    c.globalAlpha = 1;
    this.words(c);
    if (this.chosen) {
      const [x, y] = this.px(this.chosen.x, this.chosen.y);
      c.strokeStyle = tsb.colour("--ink"); c.lineWidth = 2.5;
      c.beginPath(); c.arc(x, y, r + 4, 0, 7); c.stroke();
    }
    this.scaleBar(c, metres);
  }

  /* Names of the extracts, where there is room for them. */
  words(c) {
    const taken = [];
    c.font = "600 13px system-ui, sans-serif";
    c.textAlign = "center";
    c.lineWidth = 4; c.lineJoin = "round";
    for (const [name, px, py] of this.places.sources) {
      const [x, y] = this.px(px, py), half = c.measureText(name).width / 2 + 6;
      if (x - half < 0 || x + half > this.width || y < 16 || y > this.height - 30) continue;
      if (taken.some(([a, b, h]) => Math.abs(a - x) < h + half && Math.abs(b - y) < 18)) continue;
      taken.push([x, y, half]);
      c.strokeStyle = tsb.colour("--card"); c.strokeText(name, x, y);
      c.fillStyle = tsb.colour("--ink"); c.fillText(name, x, y);
    }
  }

  scaleBar(c, metres) {
    const km = [50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1].find((d) => d * 1000 * metres <= this.width / 4) ?? 0.05;
    const y = this.height - 12;
    c.fillStyle = tsb.colour("--ink");
    c.fillRect(12, y, km * 1000 * metres, 3);
    c.font = "12px system-ui, sans-serif"; c.textAlign = "left";
    c.fillText(`${km} km`, 12, y - 5);
    c.textAlign = "right"; c.font = "11px system-ui, sans-serif";
    c.fillText("© OpenStreetMap contributors", this.width - 8, this.height - 8);
  }
};
