/* Curves over one time axis, one below the other, on a canvas: each panel with its name, unit and scale.
 *
 * tsb.curves(canvas, panels, {start, whole, now, marks, bands, colour}) returns the axis: {left, width} in px.
 * panels: {name, unit, values, dt, low, high, share, empty, line}. values: one per tick of dt s from `start`, null where there is
 *   none; low, high: what the axis shows at least; share: of the height; empty: written where there is no value at all;
 *   line: a value to compare with, dashed; null for none.
 * whole: length of the axis, s. now: s. marks: [{from, to, strong}] in s, coloured in all panels.
 * bands: [{unit, value, strong}], dashed in the panel of that unit. */
tsb.curves = (canvas, panels, { start, whole, now, marks, bands, colour }) => {
  const c = canvas.getContext("2d"), ratio = devicePixelRatio || 1, box = canvas.getBoundingClientRect(), ink = colour("--ink");
  canvas.width = Math.round(box.width * ratio); canvas.height = Math.round(box.height * ratio);
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  const left = 40, right = 10, bottom = 20, gap = 18, w = box.width - left - right;
  const room = box.height - bottom - gap * panels.length, shares = panels.reduce((sum, panel) => sum + panel.share, 0);
  const px = (s) => left + w * (s - start) / Math.max(whole, 1e-9);
  c.font = "11px system-ui, sans-serif";
  let top = 0;
  for (const panel of panels) {
    top += gap;
    const h = room * panel.share / shares, known = panel.values.filter((v) => v !== null);
    const own = bands.filter((band) => band.unit === panel.unit);
    const lowest = Math.min(panel.low, ...known, ...own.map((band) => band.value)), highest = Math.max(panel.high, ...known, ...own.map((band) => band.value));
    const step = [0.5, 1, 2, 5, 10, 20, 40, 50, 100].find((one) => (highest - lowest) / one <= Math.max(h / 18, 2)) ?? 200;
    const low = Math.floor(lowest / step + 1e-9) * step, high = Math.ceil(highest / step - 1e-9) * step;
    const py = (v) => top + h * (1 - (v - low) / (high - low));
    c.fillStyle = c.strokeStyle = ink; c.lineWidth = 1; c.setLineDash([]);
    for (let v = low; v <= high + 1e-9; v += step) {
      c.globalAlpha = v === 0 ? 0.4 : 0.18; c.beginPath(); c.moveTo(left, py(v)); c.lineTo(left + w, py(v)); c.stroke();
      c.globalAlpha = 0.75; c.textAlign = "right"; c.fillText(`${v}`.replace("-", "−"), left - 5, py(v) + 4);
    }
    c.textAlign = "left"; c.fillText(`${panel.name}, ${panel.unit}`, left, top - 6);
    c.globalAlpha = 1;
    for (const { from, to, strong } of marks) {
      const a = px(from), b = Math.max(px(to), a + 2);
      c.fillStyle = colour(strong ? "--bad" : "--warn-line");
      c.globalAlpha = 0.22; c.fillRect(a, top, b - a, h);
      c.globalAlpha = 1; c.fillRect(a - 1, top, 2, h);
    }
    if (panel.line) {
      c.strokeStyle = colour("--faint"); c.setLineDash([5, 4]); c.beginPath();
      c.moveTo(left, py(panel.line)); c.lineTo(left + w, py(panel.line)); c.stroke(); c.setLineDash([]);
    }
    for (const { value, strong } of own) {
      c.strokeStyle = colour(strong ? "--bad" : "--warn-line"); c.setLineDash([5, 4]); c.beginPath();
      c.moveTo(left, py(value)); c.lineTo(left + w, py(value)); c.stroke(); c.setLineDash([]);
    }
    c.strokeStyle = colour("--accent"); c.lineWidth = 2; c.beginPath();
    let pen = false;
    panel.values.forEach((v, k) => {
      if (v !== null) c[pen ? "lineTo" : "moveTo"](px(start + k * panel.dt), py(v));
      // A value between two gaps is a point, drawn as a line that is too short to see without its round cap.
      if (v !== null && !pen && (panel.values[k + 1] ?? null) === null) c.lineTo(px(start + k * panel.dt) + 1, py(v));
      pen = v !== null;
    });
    c.stroke();
    if (!known.length && panel.empty) {
      c.fillStyle = ink; c.globalAlpha = 0.75; c.textAlign = "left"; c.fillText(panel.empty, left + 8, top + h / 2 - 5); c.globalAlpha = 1;
    }
    top += h;
  }
  const every = [1, 2, 5, 10, 20, 30].find((s) => s * w / whole >= 44) ?? 60;
  c.fillStyle = c.strokeStyle = ink; c.globalAlpha = 0.75; c.textAlign = "center";
  for (let s = 0; s <= whole && px(start + s) < left + w - 42; s += every) c.fillText(`${s}`, px(start + s), top + 14);
  c.textAlign = "right"; c.fillText("time, s", left + w + right - 2, top + 14);
  c.globalAlpha = 1;
  for (const { from, strong } of marks) {
    if (!strong) continue;
    const a = px(from);
    c.fillStyle = colour("--bad"); c.beginPath(); c.moveTo(a - 6, gap - 7); c.lineTo(a + 6, gap - 7); c.lineTo(a, gap + 4); c.fill();
  }
  c.strokeStyle = ink; c.lineWidth = 1.5; c.beginPath(); c.moveTo(px(now), gap); c.lineTo(px(now), top); c.stroke();
  return { left, width: w };
};
