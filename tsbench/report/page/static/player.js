/* The player of one episode: what episode.py packs, on a bird's-eye view, with a time line.
 *
 * tsb.player.open(row, rows): rows are those of the table, for "previous" and "next". */
tsb.player = (() => {
  const { el } = tsb, get = (id) => document.getElementById(`player-${id}`);
  const dialog = document.getElementById("player");
  let view = null, episode = null, tick = 0, playing = false, last = 0, row = -1, rows = [], asked = 0;

  /* --- data --------------------------------------------------------------------------------------------------- */
  function ready(e) {
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
    e.duration = (e.ticks - 1) * e.dt;
    e.unpacked = true;
  }
  /* A place between two ticks: episodes are played smoothly. */
  function between(track, at, count, t) {
    const k = Math.min(Math.floor(t), count - 1), n = Math.min(k + 1, count - 1), share = t - k;
    const mix = (a) => a[at + k] + share * (a[at + n] - a[at + k]);
    return { x: mix(track.x), y: mix(track.y), h: mix(track.h) };
  }
  let colours = new Map(); // of the theme
  const colour = (name) => {
    if (!colours.has(name)) colours.set(name, tsb.colour(name));
    return colours.get(name);
  };
  const seconds = () => episode.start + tick * episode.dt;
  const begun = () => episode.events.filter((event) => event.start_s <= seconds() + 1e-6);

  /* --- drawing ------------------------------------------------------------------------------------------------ */
  function draw() {
    if (!episode) return;
    const ego = between(episode.track, 0, episode.ticks, tick), bodies = [];
    for (const part of episode.parts) {
      const t = tick - part.first;
      if (t < 0 || t > part.count - 1 + 1e-9) continue;
      bodies.push({ ...between(part, part.at, part.count, t), l: part.l, w: part.w, c: part.kind });
    }
    bodies.push({ ...ego, l: episode.ego[0], w: episode.ego[1], c: "ego" });
    const trail = [];
    for (let k = 0; k <= tick; k++) trail.push(episode.track.x[k], episode.track.y[k]);
    trail.push(ego.x, ego.y);
    const past = begun().filter((event) => event.target);
    if (get("follow").checked) view.follow(ego.x, ego.y);
    view.draw({ lines: [{ c: "trail", w: 0.35, points: trail }], marks: past, bodies });
    get("time").value = Math.round(tick);
    get("time").setAttribute("aria-valuetext", `${seconds().toFixed(1)} seconds`);
    const speed = 3.6 * episode.track.v[Math.min(Math.round(tick), episode.ticks - 1)];
    get("clock").textContent = `${seconds().toFixed(1)} s · ${speed.toFixed(0)} km/h`;
    line();
  }

  /* Speed over time; red where a rule of the target is broken, amber where that of another sign is. */
  function line() {
    const canvas = get("line"), c = canvas.getContext("2d"), ratio = devicePixelRatio || 1;
    const box = canvas.getBoundingClientRect(), ink = colour("--ink");
    canvas.width = Math.round(box.width * ratio); canvas.height = Math.round(box.height * ratio);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    const left = 34, right = 10, top = 6, bottom = 20, w = box.width - left - right, h = box.height - top - bottom;
    const kmh = episode.track.v.map((v) => 3.6 * v), drawn = episode.events.filter((e) => e.unit === "km/h");
    const highest = Math.max(20, ...kmh, ...drawn.map((e) => e.threshold)), step = highest > 90 ? 40 : highest > 40 ? 20 : 10;
    const limit = Math.ceil(highest / step) * step, whole = Math.max(episode.duration, episode.dt);
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
    c.strokeStyle = ink; c.lineWidth = 1.5; c.beginPath(); c.moveTo(px(seconds()), top); c.lineTo(px(seconds()), top + h); c.stroke();
    canvas.onpointerdown = canvas.onpointermove = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      seek(((event.offsetX - left) / w) * (episode.ticks - 1));
    };
  }

  /* The verdict: for each event of the target its sentence, and the measured value against the threshold. */
  function verdict() {
    const told = [], target = episode.events.filter((e) => e.target), others = episode.events.filter((e) => !e.target);
    const ending = episode.outcome.replaceAll("_", " ") + (episode.partner ? ` with ${episode.partner}` : "");
    const word = target.length ? "violated the sign" : episode.engaged ? "obeyed the sign" : "the sign's rule never bound it";
    told.push(el("p", {}, el("strong", { class: target.length ? "bad" : "good" }, word), ` · ${ending}`));
    if (episode.error) told.push(el("p", { class: "note warn" }, episode.error));
    for (const event of [...target, ...others]) told.push(story(event));
    get("verdict").replaceChildren(...told);
  }
  function story(event) {
    const low = Math.min(0, event.value, event.threshold), high = Math.max(0, event.value, event.threshold, low + 1e-9);
    const place = (value) => (92 * (value - low)) / (high - low) + 4; // %
    const bar = (label, value, name) => el("div", { class: "measure" }, el("span", {}, label),
      el("span", { class: "bar" }, el("span", { class: name, style:
        `left:${place(Math.min(0, value)).toFixed(1)}%;width:${Math.max(place(Math.max(0, value)) - place(Math.min(0, value)), 0.8).toFixed(1)}%` })),
      el("span", { class: "figure" }, `${tsb.number(value, 1)} ${event.unit}`));
    return el("div", { class: event.target ? "story" : "story other" },
      el("p", {}, el("button", { type: "button", on: { click: () => jump(event) } }, `${tsb.number(event.start_s, 1)} s`),
        ` ${event.sentence}`),
      event.unit ? el("div", {}, bar("measured", event.value, "bad"), bar("threshold", event.threshold, "limit")) : null,
      el("p", { class: "faint" }, `${event.target ? "" : "another sign, "}${event.sign_code} · clause ${event.clause}`
        + (event.unit ? ` · beyond by ${tsb.number(event.margin, 2)} ${event.unit}` : "")));
  }

  /* --- time --------------------------------------------------------------------------------------------------- */
  function seek(to) {
    tick = Math.min(Math.max(to, 0), episode.ticks - 1);
    remember();
    draw();
  }
  const jump = (event) => { pause(); seek((event.start_s - episode.start) / episode.dt); };
  function violation() {
    const first = episode.events.find((event) => event.target);
    if (first) jump(first);
  }
  function pause() {
    playing = false;
    get("play").textContent = "▶";
    get("play").setAttribute("aria-label", "play");
  }
  function play() {
    if (tick >= episode.ticks - 1) tick = 0;
    playing = true;
    get("play").textContent = "❚❚";
    get("play").setAttribute("aria-label", "pause");
    last = performance.now();
    requestAnimationFrame(step);
  }
  function step(now) {
    if (!playing || !dialog.open) return;
    tick += (now - last) / 1000 / episode.dt * Number(get("rate").value);
    last = now;
    if (tick >= episode.ticks - 1) { tick = episode.ticks - 1; pause(); remember(); }
    draw();
    requestAnimationFrame(step);
  }
  const toggle = () => { if (episode) { if (playing) { pause(); remember(); } else play(); } };

  /* --- opening ------------------------------------------------------------------------------------------------ */
  function remember() {
    if (!episode || playing) return;
    const name = `#play=${encodeURIComponent(`${episode.planner}/${episode.scenario}`)}&t=${seconds().toFixed(1)}`;
    history.replaceState(null, "", name);
  }
  async function open(wanted, list, time = null) {
    row = wanted; rows = list;
    const mine = ++asked;
    pause();
    if (!dialog.open) dialog.showModal();
    view ??= new tsb.Bev(get("view"));
    view.onmove = () => { get("follow").checked = false; };
    get("verdict").replaceChildren(el("p", { class: "faint" }, "loading …"));
    let found, roads;
    try {
      found = await tsb.blob(`episode/${row}`);
      roads = await tsb.blob(`roads/${found.roads}`);
      const keys = [...new Set([found.plate, ...found.scene.plates.map((plate) => plate.plate)])];
      const svgs = await Promise.all(keys.map(async (key) => [key, (await tsb.blob(`plate/${key}`)).svg]));
      view.addPlates(Object.fromEntries(svgs));
    } catch (problem) {
      if (mine !== asked) return;
      episode = null;
      view.show([]); view.draw(null);
      get("title").textContent = ""; get("sub").textContent = ""; get("clock").textContent = "";
      get("verdict").replaceChildren(el("p", { class: "note warn" }, `This episode cannot be played: ${problem.message}`));
      return;
    }
    if (mine !== asked) return; // another one was opened meanwhile
    if (!found.unpacked) ready(found);
    episode = found;
    get("title").textContent = episode.title;
    get("sub").textContent = episode.subtitle;
    get("plate").src = view.plates.get(episode.plate)?.src ?? "";
    get("plate").alt = `plate ${episode.plate.split("|")[0]}`;
    get("time").max = episode.ticks - 1;
    get("violation").disabled = !episode.events.some((event) => event.target);
    get("before").disabled = neighbour(-1) === null;
    get("next").disabled = neighbour(1) === null;
    view.show([roads.drawing, episode.scene]);
    view.onresize = () => draw();
    get("follow").checked = false;
    whole();
    verdict();
    tick = 0;
    const first = episode.events.find((event) => event.target);
    if (time !== null) seek((time - episode.start) / episode.dt);
    else if (first) seek((first.start_s - episode.start) / episode.dt - 30); // shortly before it
    else seek(0);
  }
  function whole() {
    get("follow").checked = false;
    view.fit(episode.box, 2);
    // A way too long to see anything of: the camera goes with the ego.
    if (view.camera.scale < 1.6) { view.camera.scale = 5; get("follow").checked = true; }
    draw();
  }
  function neighbour(by) {
    const at = rows.indexOf(row);
    for (let k = at + by; at >= 0 && k >= 0 && k < rows.length; k += by) if (tsb.player.can(rows[k])) return rows[k];
    return null;
  }
  const go = (by) => { const to = neighbour(by); if (to !== null) open(to, rows); };

  /* --- controls ----------------------------------------------------------------------------------------------- */
  const on = (id, event, action) => get(id).addEventListener(event, action);
  on("play", "click", toggle);
  on("time", "input", () => { pause(); seek(Number(get("time").value)); });
  on("violation", "click", violation);
  on("in", "click", () => view.zoom(1.4));
  on("out", "click", () => view.zoom(1 / 1.4));
  on("whole", "click", whole);
  on("follow", "change", draw);
  on("before", "click", () => go(-1));
  on("next", "click", () => go(1));
  on("close", "click", () => dialog.close());
  dialog.addEventListener("close", () => { pause(); asked++; episode = null; history.replaceState(null, "", "#episodes"); });
  tsb.themed.add(() => { colours = new Map(); draw(); });
  dialog.addEventListener("keydown", (event) => {
    if (!episode || event.ctrlKey || event.metaKey || event.altKey) return;
    const field = event.target.tagName, key = event.key;
    if (field === "SELECT" || (key === " " && ["BUTTON", "INPUT", "SUMMARY"].includes(field) && event.target.id !== "player-time")) return;
    const by = (n) => { pause(); seek(Math.round(tick) + n); };
    const actions = {
      " ": toggle, ArrowLeft: () => by(event.shiftKey ? -10 : -1), ArrowRight: () => by(event.shiftKey ? 10 : 1),
      Home: () => by(-Infinity), End: () => by(Infinity), v: violation, "+": () => view.zoom(1.4), "=": () => view.zoom(1.4),
      "-": () => view.zoom(1 / 1.4), f: () => { get("follow").checked = !get("follow").checked; draw(); },
      n: () => go(1), p: () => go(-1),
    };
    const action = actions[key] ?? actions[key.toLowerCase()];
    if (action) { event.preventDefault(); action(); }
  });
  const named = { ego: "ego", trail: "its trail", route: "navigation's way", compliant: "an obedient way", plate_line: "target plate, its line, its rule's zone",
    destination: "destination", convoy: "held for the ego", car: "car", bus: "bus", bicycle: "bicycle", pedestrian: "pedestrian", violation: "violation" };
  get("legend").append(...Object.entries(named).map(([name, text]) =>
    el("span", { class: "key" }, el("i", { style: `background:var(--bev-${name})` }), text)));
  return { open, can: () => false, get episode() { return episode; }, get tick() { return tick; }, get playing() { return playing; } };
})();
