/* The player: one episode, the rows of a pair or square, or two planners' drives of one scene, side by side on one time axis.
 *
 * tsb.player.open(row, rows): rows are those of the table, for "previous" and "next". Its `can(row)`, `square(row)`
 * (rows of its pair or square, itself among them, by their ids), `passed(row)`, `rivals(row)` (rows of the same scene by planner), `who(row)` (its
 * planner) and `name(row)` (in links) are the table's. */
tsb.player = (() => {
  const { el, Half } = tsb, get = (id) => document.getElementById(`player-${id}`);
  const dialog = document.getElementById("player");
  const stages = ["", "-2", "-3", "-4"].map((suffix) => new Half(suffix));
  let shown = [], main = null; // the halves that are played, the signed one first; the one that was opened
  let tick = 0, playing = false, last = 0, row = -1, rows = [], asked = 0;
  let beside = ""; // the planner that is shown beside; "": the other half
  let mates = []; // rows of the pair or square of the one that was opened
  const api = { open, can: () => false, passed: () => false, square: (row) => [row], rivals: () => new Map(), name: String, who: String, get episode() { return main?.episode ?? null; },
    get halves() { return shown.map((half) => half.episode); }, get cameras() { return shown.map((half) => half.view.camera); },
    get tick() { return tick; }, get playing() { return playing; } };

  const end = () => Math.max(...shown.map((half) => half.last));
  const seconds = () => main.episode.start + tick * main.episode.dt;

  function draw() {
    if (!main) return;
    for (const half of shown) { half.curves = get("curves").checked; half.draw(tick, end(), get("follow").checked); }
    get("time").value = Math.round(tick);
    get("time").setAttribute("aria-valuetext", `${seconds().toFixed(1)} seconds`);
    const speeds = shown.map((half) => half.kmh(tick).toFixed(0)).join(" | ");
    get("clock").textContent = `${seconds().toFixed(1)} s · ${speeds} km/h`;
  }

  /* --- time --------------------------------------------------------------------------------------------------- */
  function seek(to) {
    tick = Math.min(Math.max(to, 0), end());
    remember();
    draw();
  }
  function jump(half, event) { pause(); seek(half.ticks(event)); }
  const broken = () => [main, ...shown].find((half) => half.first);
  function violation() {
    const half = broken();
    if (half) jump(half, half.first);
  }
  function pause() {
    playing = false;
    get("play").textContent = "▶";
    get("play").setAttribute("aria-label", "play");
  }
  function play() {
    if (tick >= end()) tick = 0;
    playing = true;
    get("play").textContent = "❚❚";
    get("play").setAttribute("aria-label", "pause");
    last = performance.now();
    requestAnimationFrame(step);
  }
  function step(now) {
    if (!playing || !dialog.open) return;
    tick += (now - last) / 1000 / main.episode.dt * Number(get("rate").value);
    last = now;
    if (tick >= end()) { tick = end(); pause(); remember(); }
    draw();
    requestAnimationFrame(step);
  }
  const toggle = () => { if (main) { if (playing) { pause(); remember(); } else play(); } };

  /* --- opening ------------------------------------------------------------------------------------------------ */
  function remember() {
    if (!main || playing) return;
    history.replaceState(null, "", `#play=${encodeURIComponent(api.name(row))}&t=${seconds().toFixed(1)}`);
  }
  async function open(wanted, list, time = null) {
    row = wanted; rows = list;
    const mine = ++asked, rowsShown = choose();
    pause();
    if (!dialog.open) { dialog.showModal(); dialog.scrollTop = 0; }
    stages[0].get("verdict").replaceChildren(el("p", { class: "faint" }, "loading …"));
    let found, why = "";
    const alone = (problem) => { why = problem.message; return null; };
    try {
      found = await Promise.all(rowsShown.map((k) => k === row ? Half.load(k) : api.can(k) ? Half.load(k).catch(alone) : null));
      found = found.filter((one) => one !== null);
    } catch (problem) {
      if (mine !== asked) return;
      main = null;
      arrange(1);
      stages[0].clear(problem);
      get("clock").textContent = "";
      return;
    }
    if (mine !== asked) return; // another one was opened meanwhile
    arrange(found.length);
    get("alone").hidden = beside !== "" || found.length === rowsShown.length;
    get("why").textContent = why || `tsbench view ${tsb.json("folders")?.[api.who(row)] ?? ""} drives it again, and shows it.`;
    const name = ({ episode, row: at }) => found.length < 2 ? "" : beside ? api.who(at) : episode.which;
    found.forEach((one, k) => stages[k].show(one, name(one)));
    main = shown[found.findIndex((one) => one.row === row)];
    get("time").max = end();
    get("violation").disabled = !broken();
    get("before").disabled = neighbour(-1) === null;
    get("next").disabled = neighbour(1) === null;
    for (const half of shown) connect(half);
    tick = 0;
    whole();
    if (time !== null) seek((time - main.episode.start) / main.episode.dt);
    else if (broken()) seek(broken().ticks(broken().first) - 30); // shortly before it
    else seek(0);
    if (time === null && !matchMedia("(prefers-reduced-motion: reduce)").matches) play();
  }
  /* The rows that are shown, in order, and what else could be beside the one that was opened. */
  function choose() {
    const rivals = api.rivals(row), names = [...rivals.keys()];
    mates = api.square(row);
    if (!rivals.has(beside)) beside = "";
    get("beside").replaceChildren(...["", ...names].map((name) => el("option", { value: name }, name || "the other half")));
    get("beside").value = beside;
    get("beside").parentElement.hidden = names.length === 0;
    return beside ? [row, rivals.get(beside)] : mates;
  }
  function arrange(count) {
    shown = stages.slice(0, count);
    dialog.classList.toggle("two", count > 1);
    dialog.classList.toggle("four", count > 2);
    if (count > 2) get("curves").checked = false; // or the lower two are below the screen
    stages.forEach((_, k) => { if (k) get(`half-${k + 1}`).hidden = k >= count; });
  }
  /* What one half is told is done in both; the camera that is moved takes the other one along. */
  function connect(half) {
    const { view } = half, others = shown.filter((one) => one !== half);
    const along = () => { for (const { view: one } of others) { one.camera = { ...view.camera }; one.redraw(); } };
    half.onseek = seek;
    half.onjump = (event) => jump(half, event);
    view.onmove = () => { get("follow").checked = false; along(); };
    view.onzoom = along;
    view.onresize = draw;
  }
  function whole() {
    get("follow").checked = false;
    const boxes = shown.map((half) => half.episode.box);
    const box = [0, 1, 2, 3].map((k) => Math[k < 2 ? "min" : "max"](...boxes.map((one) => one[k])));
    for (const { view } of shown) {
      view.fit(box, 2);
      // A way too long to see anything of: the camera goes with the ego.
      if (view.camera.scale < 1.6) { view.camera.scale = 5; get("follow").checked = true; }
    }
    draw();
  }
  function neighbour(by, failed = false) {
    const at = rows.indexOf(row), others = failed ? [] : mates;
    for (let k = at + by; at >= 0 && k >= 0 && k < rows.length; k += by)
      if (!others.includes(rows[k]) && api.can(rows[k]) && !(failed && api.passed(rows[k]))) return rows[k];
    return null;
  }
  const go = (by, failed) => { const to = neighbour(by, failed); if (to !== null) open(to, rows); };
  const zoom = (factor) => shown[0]?.view.zoom(factor);

  /* --- controls ----------------------------------------------------------------------------------------------- */
  const on = (id, event, action) => get(id).addEventListener(event, action);
  on("play", "click", toggle);
  on("time", "input", () => { pause(); seek(Number(get("time").value)); });
  on("violation", "click", violation);
  on("in", "click", () => zoom(1.4));
  on("out", "click", () => zoom(1 / 1.4));
  on("whole", "click", whole);
  on("follow", "change", draw);
  get("curves").checked = matchMedia("(min-width: 800px)").matches;
  on("curves", "change", draw);
  on("beside", "change", () => { beside = get("beside").value; if (main) open(row, rows, seconds()); });
  on("before", "click", () => go(-1));
  on("next", "click", () => go(1));
  on("close", "click", () => dialog.close());
  dialog.addEventListener("close", () => { pause(); asked++; main = null; history.replaceState(null, "", "#episodes"); });
  tsb.themed.add(() => { Half.colours = new Map(); draw(); });
  dialog.addEventListener("keydown", (event) => {
    if (!main || event.ctrlKey || event.metaKey || event.altKey) return;
    const field = event.target.tagName, key = event.key;
    if (field === "SELECT" || (key === " " && ["BUTTON", "INPUT", "SUMMARY"].includes(field) && event.target.id !== "player-time")) return;
    const by = (n) => { pause(); seek(Math.round(tick) + n); };
    const actions = {
      " ": toggle, ArrowLeft: () => by(event.shiftKey ? -10 : -1), ArrowRight: () => by(event.shiftKey ? 10 : 1),
      Home: () => by(-Infinity), End: () => by(Infinity), v: violation, "+": () => zoom(1.4), "=": () => zoom(1.4),
      "-": () => zoom(1 / 1.4), f: () => { get("follow").checked = !get("follow").checked; draw(); },
      n: () => go(1), p: () => go(-1), "]": () => go(1, true), "[": () => go(-1, true),
    };
    const action = actions[key] ?? actions[key.toLowerCase()];
    if (action) { event.preventDefault(); action(); }
  });
  const named = { ego: "ego", trail: "its trail", plan: "its plan", route: "navigation's way", compliant: "an obedient way", plate_line: "target plate, its line, its rule's zone",
    destination: "destination", convoy: "held for the ego", car: "car", bus: "bus", bicycle: "bicycle", pedestrian: "pedestrian",
    lamp: "indicator", brake: "brakes", violation: "violation" };
  get("legend").parentElement.open = matchMedia("(min-width: 800px)").matches;
  get("legend").append(...Object.entries(named).map(([name, text]) =>
    el("span", { class: "key" }, el("i", { style: `background:var(--bev-${name})` }), text)));
  return api;
})();
