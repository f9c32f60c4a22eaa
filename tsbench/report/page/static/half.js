/* One episode on a stage of the player: what episode.py packs, on a bird's-eye view, with its own time line.
 *
 * new tsb.Half(suffix): of its elements' ids, "" or "-2". Times are ticks from the start, fractions allowed. */
tsb.Half = class {
  static colours = new Map(); // of the theme
  static colour(name) {
    if (!this.colours.has(name)) this.colours.set(name, tsb.colour(name));
    return this.colours.get(name);
  }

  constructor(suffix) {
    this.get = (id) => document.getElementById(`player${suffix}-${id}`);
    this.episode = null;
    this.onseek = null; // called with ticks when the time line is pressed
    this.onjump = null; // called with an event when its time is pressed
  }

  /* Fetch what a row plays; it is shown by `show`. */
  static async load(row) {
    const episode = await tsb.blob(`episode/${row}`);
    const roads = await tsb.blob(`roads/${episode.roads}`);
    const keys = [...new Set([episode.plate, ...episode.scene.plates.map((plate) => plate.plate)])];
    const svgs = await Promise.all(keys.map(async (key) => [key, (await tsb.blob(`plate/${key}`)).svg]));
    if (!episode.unpacked) tsb.Half.unpack(episode);
    return { row, episode, roads, svgs };
  }

  static unpack(e) {
    const { units, array } = e, one = [e.ticks];
    const motion = (name, lengths) => ({
      x: tsb.summed(array[`${name}_x`], lengths, units.m).map((v) => v + e.middle[0]),
      y: tsb.summed(array[`${name}_y`], lengths, units.m).map((v) => v + e.middle[1]),
      h: tsb.summed(array[`${name}_h`], lengths, units.rad) });
    e.track = { ...motion("ego", one), v: tsb.summed(array.ego_v, one, units.mps) };
    const others = motion("actor", e.pieces.map((piece) => piece[2]));
    let at = 0;
    e.parts = e.pieces.map(([actor, first, count]) => {
      const part = { kind: e.actors[actor][1], l: e.actors[actor][2], w: e.actors[actor][3], first, count, at, ...others };
      at += count;
      return part;
    });
    const plan = ["x", "y"].map((axis, k) =>
      tsb.summed(array[`plan_${axis}`], e.plans.map((one) => one[1]), units.plan).map((v) => v + e.middle[k]));
    let from = 0;
    e.planned = new Map(e.plans.map(([tick, count]) => {
      const points = [];
      for (const to = from + count; from < to; from++) points.push(plan[0][from], plan[1][from]);
      return [tick, points];
    }));
    e.unpacked = true;
  }

  /* named: what stands before the verdict, such as which half it is of. */
  show({ episode, roads, svgs }, named) {
    this.view ??= new tsb.Bev(this.get("view"));
    this.episode = episode;
    this.view.addPlates(Object.fromEntries(svgs));
    this.get("title").textContent = episode.title;
    this.get("sub").textContent = episode.subtitle;
    this.get("plate").src = this.view.plates.get(episode.plate)?.src ?? "";
    this.get("plate").alt = `plate ${episode.plate.split("|")[0]}`;
    this.view.show([roads.drawing, episode.scene]);
    this.verdict(named ? `${named}: ` : "");
  }

  clear(problem) {
    this.episode = null;
    this.view?.show([]);
    this.view?.draw(null);
    this.get("title").textContent = "";
    this.get("sub").textContent = "";
    this.get("verdict").replaceChildren(tsb.el("p", { class: "note warn" }, `This episode cannot be played: ${problem.message}`));
  }

  get last() { return this.episode.ticks - 1; }
  get first() { return this.episode.events.find((event) => event.target) ?? null; }
  ticks(event) { return (event.start_s - this.episode.start) / this.episode.dt; }
  kmh(tick) { return 3.6 * this.episode.track.v[Math.min(Math.round(tick), this.last)]; }

  /* A place between two ticks: episodes are played smoothly. */
  static between(track, at, count, t) {
    const k = Math.min(Math.floor(t), count - 1), n = Math.min(k + 1, count - 1), share = t - k;
    const mix = (a) => a[at + k] + share * (a[at + n] - a[at + k]);
    return { x: mix(track.x), y: mix(track.y), h: mix(track.h) };
  }

  /* Does somebody brake, by the ways before and behind a tick? Places are of whole 5 cm: half a second of each will do. */
  static slows(part, t, dt) {
    const n = Math.round(0.5 / dt);
    if (t < n || t + n > part.count - 1) return false;
    const way = (a, b) => Math.hypot(part.x[part.at + b] - part.x[part.at + a], part.y[part.at + b] - part.y[part.at + a]);
    return (way(t - n, t) - way(t, t + n)) / (n * dt) ** 2 > 1.0;
  }

  /* The state at a tick, or at the end where that came before. whole: ticks of the time axis. */
  draw(wanted, whole, follow) {
    const { episode } = this, tick = Math.min(wanted, this.last), { between } = tsb.Half;
    const ego = between(episode.track, 0, episode.ticks, tick), bodies = [];
    for (const part of episode.parts) {
      const t = tick - part.first;
      if (t < 0 || t > part.count - 1 + 1e-9) continue;
      const brakes = tsb.Half.slows(part, Math.round(t), episode.dt);
      bodies.push({ ...between(part, part.at, part.count, t), l: part.l, w: part.w, c: part.kind, brakes });
    }
    const v = episode.track.v, now = Math.min(Math.round(tick), this.last);
    const brakes = now > 0 && (v[now - 1] - v[now]) / episode.dt > 0.8;
    bodies.push({ ...ego, l: episode.ego[0], w: episode.ego[1], c: "ego", brakes });
    const trail = [];
    for (let k = 0; k <= tick; k++) trail.push(episode.track.x[k], episode.track.y[k]);
    trail.push(ego.x, ego.y);
    const past = episode.events.filter((event) => event.target && this.ticks(event) <= tick + 1e-5);
    if (follow) this.view.follow(ego.x, ego.y);
    const plan = episode.planned.get(Math.floor(tick)) ?? [];
    const lines = [{ c: "trail", w: 0.35, points: trail }, { c: "plan", w: 0.35, points: plan }];
    this.view.draw({ lines, marks: past, bodies });
    this.line(wanted, whole);
  }

  /* Speed over time; red where a rule of the target is broken, amber where that of another sign is. */
  line(tick, ticks) {
    const { episode } = this, colour = (name) => tsb.Half.colour(name);
    const canvas = this.get("line"), c = canvas.getContext("2d"), ratio = devicePixelRatio || 1;
    const box = canvas.getBoundingClientRect(), ink = colour("--ink");
    canvas.width = Math.round(box.width * ratio); canvas.height = Math.round(box.height * ratio);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    const left = 34, right = 10, top = 6, bottom = 20, w = box.width - left - right, h = box.height - top - bottom;
    const kmh = episode.track.v.map((v) => 3.6 * v), drawn = episode.events.filter((e) => e.unit === "km/h");
    const highest = Math.max(20, ...kmh, ...drawn.map((e) => e.threshold)), step = highest > 90 ? 40 : highest > 40 ? 20 : 10;
    const limit = Math.ceil(highest / step) * step, whole = Math.max(ticks, 1) * episode.dt;
    const px = (s) => left + w * (s - episode.start) / whole, py = (v) => top + h * (1 - v / limit);
    c.font = "11px system-ui, sans-serif"; c.fillStyle = ink; c.strokeStyle = ink;
    for (let v = 0; v <= limit; v += step) {
      c.globalAlpha = 0.18; c.beginPath(); c.moveTo(left, py(v)); c.lineTo(left + w, py(v)); c.stroke();
      c.globalAlpha = 0.75; c.textAlign = "right"; c.fillText(v === limit ? `${v}` : v, left - 5, py(v) + 4);
    }
    const every = [1, 2, 5, 10, 20, 30].find((s) => s * w / whole >= 44) ?? 60;
    c.textAlign = "center";
    for (let s = 0; s <= whole; s += every) c.fillText(`${s}`, px(episode.start + s), top + h + 14);
    c.textAlign = "left"; c.fillText("km/h", left + 3, top + 9);
    c.textAlign = "right"; c.fillText("s", left + w + right - 2, top + h + 14);
    c.globalAlpha = 1;
    for (const event of episode.events) {
      const a = px(event.start_s), b = Math.max(px(event.end_s), a + 2);
      c.fillStyle = colour(event.target ? "--bad" : "--warn-line");
      c.globalAlpha = 0.22; c.fillRect(a, top, b - a, h);
      c.globalAlpha = 1; c.fillRect(a - 1, top, 2, h);
      if (event.target) { c.beginPath(); c.moveTo(a - 6, top - 5); c.lineTo(a + 6, top - 5); c.lineTo(a, top + 6); c.fill(); }
      if (event.unit === "km/h") {
        c.strokeStyle = c.fillStyle; c.setLineDash([5, 4]); c.beginPath();
        c.moveTo(left, py(event.threshold)); c.lineTo(left + w, py(event.threshold)); c.stroke(); c.setLineDash([]);
      }
    }
    c.strokeStyle = colour("--accent"); c.lineWidth = 2; c.beginPath();
    kmh.forEach((v, k) => c[k ? "lineTo" : "moveTo"](px(episode.start + k * episode.dt), py(v)));
    c.stroke();
    const now = px(episode.start + tick * episode.dt);
    c.strokeStyle = ink; c.lineWidth = 1.5; c.beginPath(); c.moveTo(now, top); c.lineTo(now, top + h); c.stroke();
    canvas.onpointerdown = canvas.onpointermove = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      this.onseek(((event.offsetX - left) / w) * ticks);
    };
  }

  /* The verdict: for each event of the target its sentence, and the measured value against the threshold. */
  verdict(name) {
    const { episode } = this, { el } = tsb;
    const told = [], target = episode.events.filter((e) => e.target), others = episode.events.filter((e) => !e.target);
    const ending = episode.outcome.replaceAll("_", " ") + (episode.partner ? ` with ${episode.partner}` : "");
    const needless = target.length > 0 && target.every((e) => e.clause.startsWith("needless_"));
    const word = needless ? "obeyed what the sign does not ask" : target.length ? "violated the sign"
      : episode.engaged ? "obeyed the sign" : "the sign's rule never bound it";
    told.push(el("p", {}, name, el("strong", { class: target.length ? "bad" : "good" }, word), ` · ${ending}`));
    if (episode.error) told.push(el("p", { class: "note warn" }, episode.error));
    for (const event of [...target, ...others]) told.push(this.story(event));
    if (episode.told.length) told.push(el("div", { class: "story other" }, el("p", { class: "faint" }, "what the planner was told of plates"),
      ...episode.told.map((one) => this.heard(one))));
    this.get("verdict").replaceChildren(...told);
  }

  /* One thing that imperfect eyes told, beside what stood there. */
  heard(one) {
    const { el } = tsb, name = (key) => key.replace("|", ", ");
    const word = { right: `read ${name(one.told)}`, misread: `read ${name(one.told)}, it is ${name(one.stood)}`,
      false: `read ${name(one.told)}, nothing stands there`, post: `a post in sight, not read: ${name(one.stood)}` }[one.kind];
    return el("p", { class: one.kind === "misread" || one.kind === "false" ? "bad" : "" },
      el("button", { type: "button", on: { click: () => this.onjump({ start_s: one.time }) } }, `${tsb.number(one.time, 1)} s`),
      ` ${one.target ? "the sign: " : ""}${word}`);
  }

  story(event) {
    const { el } = tsb;
    const low = Math.min(0, event.value, event.threshold), high = Math.max(0, event.value, event.threshold, low + 1e-9);
    const place = (value) => (92 * (value - low)) / (high - low) + 4; // %
    const bar = (label, value, name) => el("div", { class: "measure" }, el("span", {}, label),
      el("span", { class: "bar" }, el("span", { class: name, style:
        `left:${place(Math.min(0, value)).toFixed(1)}%;width:${Math.max(place(Math.max(0, value)) - place(Math.min(0, value)), 0.8).toFixed(1)}%` })),
      el("span", { class: "figure" }, `${tsb.number(value, 1)} ${event.unit}`));
    return el("div", { class: event.target ? "story" : "story other" },
      el("p", {}, el("button", { type: "button", on: { click: () => this.onjump(event) } }, `${tsb.number(event.start_s, 1)} s`),
        ` ${event.sentence}`),
      event.unit ? el("div", {}, bar("measured", event.value, "bad"), bar("threshold", event.threshold, "limit")) : null,
      el("p", { class: "faint" }, `${event.target ? "" : "another sign, "}${event.sign_code} · clause ${event.clause}`
        + (event.unit ? ` · beyond by ${tsb.number(event.margin, 2)} ${event.unit}` : "")));
  }
};
