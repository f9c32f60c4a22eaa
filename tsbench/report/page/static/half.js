/* One episode on a stage of the player: what episode.py packs, on a bird's-eye view, with its own time line.
 *
 * new tsb.Half(suffix): of its elements' ids, "" or "-2" to "-4". Times are ticks from the start, fractions allowed. */
tsb.Half = class {
  static colours = new Map(); // of the theme
  static colour(name) {
    if (!this.colours.has(name)) this.colours.set(name, tsb.colour(name));
    return this.colours.get(name);
  }

  constructor(suffix) {
    this.get = (id) => document.getElementById(`player${suffix}-${id}`);
    this.episode = null;
    this.curves = false; // all of them, or speed alone?
    this.onseek = null; // called with ticks when the time line is pressed
    this.onjump = null; // called with an event when its time is pressed
  }

  /* Fetch what a row plays; it is shown by `show`. */
  static async load(row) {
    const episode = await tsb.blob(`episode/${row}`);
    const roads = await tsb.blob(`roads/${episode.roads}`);
    const keys = [...new Set([episode.plate, ...episode.scene.plates.flatMap((plate) => [plate.plate, plate.below].filter(Boolean))])];
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
    const near = (name) => of(name, units.s).map((v) => v > e.farthest_s ? null : v);
    const of = (name, unit) => Array.from(tsb.summed(array[`ego_${name}`], one, unit));
    e.track = { ...motion("ego", one), v: tsb.summed(array.ego_v, one, units.mps), a: of("a", units.mps2),
      steer: of("steer", units.rad * 180 / Math.PI), ttc: near("ttc"), conflict: array.ego_conflict ? near("conflict") : null };
    const others = motion("actor", e.pieces.map((piece) => piece[2]));
    let at = 0;
    e.parts = e.pieces.map(([actor, first, count]) => {
      const [name, kind, l, w] = e.actors[actor];
      const part = { name, kind, l, w, from: e.named[name] ?? Infinity, lights: array.actor_lights, first, count, at, ...others };
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

  /* Which lights are on: 1 left, 2 right indicator, 4 brakes. */
  static lights(bits) { return { signals: bits & 1 ? 1 : bits & 2 ? -1 : 0, brakes: Boolean(bits & 4) }; }

  /* The state at a tick, or at the end where that came before. whole: ticks of the time axis. */
  draw(wanted, whole, follow) {
    const { episode } = this, tick = Math.min(wanted, this.last), { between, lights } = tsb.Half;
    const time = episode.start + tick * episode.dt + 1e-6;
    const ego = between(episode.track, 0, episode.ticks, tick), bodies = [];
    for (const part of episode.parts) {
      const t = tick - part.first;
      if (t < 0 || t > part.count - 1 + 1e-9) continue;
      bodies.push({ ...between(part, part.at, part.count, t), l: part.l, w: part.w, c: part.kind,
        ...lights(part.lights[part.at + Math.min(Math.round(t), part.count - 1)]), name: part.from <= time ? part.name : "" });
    }
    bodies.push({ ...ego, l: episode.ego[0], w: episode.ego[1], c: "ego", ...lights(episode.array.ego_lights[Math.min(Math.round(tick), this.last)]) });
    const labels = [...bodies, ...episode.obstacles.filter(([name]) => episode.named[name] <= time).map(([name, x, y]) => ({ name, x, y }))];
    const trail = [];
    for (let k = 0; k <= tick; k++) trail.push(episode.track.x[k], episode.track.y[k]);
    trail.push(ego.x, ego.y);
    const past = episode.events.filter((event) => event.target && this.ticks(event) <= tick + 1e-5);
    if (follow) this.view.follow(ego.x, ego.y);
    const plan = episode.planned.get(Math.floor(tick)) ?? [];
    const lines = [{ c: "trail", w: 0.35, points: trail }, { c: "plan", w: 0.35, points: plan }];
    this.view.draw({ lines, marks: past, bodies, labels: labels.filter((one) => one.name).map((one) => ({ ...one, left: one.x < ego.x })) });
    this.line(wanted, whole);
  }

  /* What the ego did over time; red where a rule of the target is broken, amber where that of another sign is. */
  line(tick, ticks) {
    const { episode } = this, { dt, start, track } = episode;
    const panel = (name, unit, values, low, high, share) => ({ name, unit, values, dt, low, high, share });
    const panels = [panel("speed", "km/h", track.v.map((v) => 3.6 * v), 0, 20, 3)];
    if (this.curves) {
      panels.push(panel("acceleration", "m/s²", track.a, -2, 2, 2), panel("steering, left is positive", "°", track.steer, -10, 10, 2),
        { ...panel("time to collision", "s", track.ttc, 0, 10, 2), empty: `on collision course with nobody within ${episode.farthest_s} s` });
    }
    if (this.curves && track.conflict) {
      panels.push({ ...panel("time to conflict", "s", track.conflict, 0, 10, 2), empty: `nobody comes within ${episode.farthest_s} s`, line: episode.gap_s });
    }
    const canvas = this.get("line");
    canvas.classList.toggle("taller", panels.length > 4);
    canvas.classList.toggle("tall", this.curves);
    const { left, width } = tsb.curves(canvas, panels, {
      start, whole: Math.max(ticks, 1) * dt, now: start + tick * dt, colour: (name) => tsb.Half.colour(name),
      marks: episode.events.map((event) => ({ from: event.start_s, to: event.end_s, strong: event.target })),
      bands: episode.events.filter((event) => event.unit === "km/h").map((event) => ({ unit: event.unit, value: event.threshold, strong: event.target })),
    });
    canvas.onpointerdown = canvas.onpointermove = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      this.onseek(((event.offsetX - left) / width) * ticks);
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
    if (episode.otherwise) told.push(el("p", { class: "faint" }, episode.otherwise));
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
    // As many decimals as tell the two apart.
    const digits = [1, 2, 3].find((n) => event.value.toFixed(n) !== event.threshold.toFixed(n)) ?? 1;
    const place = (value) => (92 * (value - low)) / (high - low) + 4; // %
    const bar = (label, value, name) => el("div", { class: "measure" }, el("span", {}, label),
      el("span", { class: "bar" }, el("span", { class: name, style:
        `left:${place(Math.min(0, value)).toFixed(1)}%;width:${Math.max(place(Math.max(0, value)) - place(Math.min(0, value)), 0.8).toFixed(1)}%` })),
      el("span", { class: "figure" }, `${tsb.number(value, digits)} ${event.unit}`));
    return el("div", { class: event.target ? "story" : "story other" },
      el("p", {}, el("button", { type: "button", on: { click: () => this.onjump(event) } }, `${tsb.number(event.start_s, 1)} s`),
        ` ${event.sentence}`),
      event.unit ? el("div", {}, bar("measured", event.value, "bad"), bar("threshold", event.threshold, "limit")) : null,
      el("p", { class: "faint" }, `${event.target ? "" : "another sign, "}${event.sign_code} · clause ${event.clause}`
        + (event.unit ? ` · beyond by ${tsb.number(event.margin, 2)} ${event.unit}` : "")));
  }
};
