"use strict";
/* The data set's page: the map and the cards filter the table, its rows open scenes. */
(() => {
  const { el } = tsb, id = (name) => document.getElementById(name);
  let table = null, details = null, bev = null, row = 0, rows = [], box = null;
  const filter = (values) => { table?.filter(values); location.hash = "scenarios"; };

  /* --- the map -------------------------------------------------------------------------------------------------- */
  tsb.blob("places").then((places) => {
    const told = (place) => {
      if (!place) { id("map-told").replaceChildren(el("p", { class: "faint" }, "No map is chosen.")); return; }
      id("map-told").replaceChildren(
        el("p", {}, el("strong", {}, place.id), ` · ${place.split} · ${place.road} · ${place.source} · ${place.lat}° N, ${place.lon}° E`),
        el("p", {}, ...place.types.map((type) => el("button", { type: "button", class: "quiet",
          on: { click: () => filter({ scenario_type: type, map_id: place.id }) } }, type))));
    };
    const map = tsb.placeMap = new tsb.PlaceMap(id("map-view"), places, told);
    id("map-type").addEventListener("input", (event) => { map.type = event.target.value; map.chosen = null; told(null); map.redraw(); });
    id("map-in").addEventListener("click", () => map.zoom(1.5));
    id("map-out").addEventListener("click", () => map.zoom(1 / 1.5));
    id("map-whole").addEventListener("click", () => map.whole());
  });

  /* --- a scene -------------------------------------------------------------------------------------------------- */
  const names = [["ego", "ego at its start"], ["route", "navigation's way"], ["compliant", "obedient way"],
    ["convoy", "convoy, held until the ego comes"], ["car", "car that waits or leads"], ["pedestrian", "pedestrian"],
    ["destination", "destination"], ["plate_line", "line of the plate, and the rule's zone"]];

  const legend = (scene) => {
    const there = new Set([...scene.areas, ...scene.lines, ...scene.bodies].map((part) => part.c));
    const sheet = getComputedStyle(id("scene-view"));
    id("scene-legend").replaceChildren(...names.filter(([key]) => there.has(key)).map(([key, words]) =>
      el("span", { class: "key" }, el("i", { style: `background:${sheet.getPropertyValue(`--bev-${key}`)}` }), words)));
  };

  /* A box around all plates, bodies and lines of a scene. */
  const around = (scene) => {
    const found = [Infinity, Infinity, -Infinity, -Infinity];
    const take = (x, y) => {
      found[0] = Math.min(found[0], x); found[1] = Math.min(found[1], y);
      found[2] = Math.max(found[2], x); found[3] = Math.max(found[3], y);
    };
    for (const thing of [...scene.plates, ...scene.bodies]) take(thing.x, thing.y);
    for (const list of scene.lines.flatMap((line) => line.p)) {
      let x = 0, y = 0;
      for (let k = 0; k < list.length; k += 2) {
        x += list[k]; y += list[k + 1];
        take(scene.x0 + x * scene.unit, scene.y0 + y * scene.unit);
      }
    }
    return found;
  };

  const facts = () => {
    const cell = (name) => table.text(name, row), d = details.values;
    const text = (name) => d[name].distinct[d[name].at[row]];
    const figure = (name, unit, digits = 0) => (d[name][row] === null ? null : `${tsb.number(d[name][row], digits)} ${unit}`.trim());
    const density = d.density[row] ? `${cell("asked_density")} asked, ${cell("realised_density")} realised, cars per lane-km` : "no traffic";
    return [
      ["solved by", cell("expert") === "nobody" ? "nobody" : `${cell("expert")} after ${cell("expert_time_s")} s`],
      ["tempting", `${cell("tempting")}: ${text("blind_baseline")} ended with “${cell("blind_outcome").replaceAll("_", " ")}”, engaged: ${cell("engaged")}`],
      ["sane", `${cell("sane")}, ${figure("road_users", "others met")}`],
      ["reproduced", cell("reproduced")],
      ["traffic", density],
      ["gap to the convoy", cell("arrival_gap_s") ? `${cell("arrival_gap_s")} s` : null],
      ["sign", text("sign_code") + (d.sign_value[row] === null ? "" : ` (${tsb.number(d.sign_value[row], 0)} km/h)`)],
      ["initial speed", figure("initial_speed", "m/s", 1)],
      ["way after the decision", figure("route_length", "m")],
      ["horizon", `${tsb.number(d.horizon[row] / 10, 0)} s`],
      ["map", `${cell("map_id")}, ${text("family").replaceAll("_", " ")}, ${text("shape")}`],
      ["layout", figure("layout", "")], ["seed", text("seed")], ["draw kept", figure("attempt", "")],
      ["open in SUMO", `tsbench scenarios open ${cell("scenario_id")}`],
    ].filter(([, words]) => words !== null);
  };

  const show = async () => {
    const asked = row, cell = (name) => table.text(name, row);
    id("scene-title").textContent = cell("scenario_id");
    id("scene-sub").textContent = `${cell("scenario_type")} · ${cell("group")} · ${cell("split")} · variant ${cell("variant")}, ${cell("half")} half`;
    id("scene-facts").replaceChildren(...facts().map(([name, words]) => el("div", {}, el("dt", {}, name), el("dd", {}, words))));
    const at = rows.indexOf(row);
    id("scene-before").disabled = at <= 0;
    id("scene-next").disabled = at < 0 || at >= rows.length - 1;
    id("scene-problem").hidden = true;
    history.replaceState(null, "", `#scene=${encodeURIComponent(cell("scenario_id"))}`);
    try {
      const packed = await tsb.blob(`scene/${cell("scenario_type")}/${cell("map_id")}`);
      if (asked !== row) return;
      const scene = packed.scenes[cell("scenario_id")];
      const target = scene.plates.find((plate) => plate.target);
      id("scene-plate").src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(tsb.json("plates")[target.plate]);
      id("scene-plate").alt = `plate ${target.plate}`;
      bev.show([packed.roads[scene.net], scene]);
      box = around(scene);
      bev.fit(box, 14);
      legend(scene);
    } catch (problem) {
      id("scene-problem").textContent = `This scene cannot be shown: ${problem.message}`;
      id("scene-problem").hidden = false;
    }
  };

  const open = async (which, list) => {
    details ??= await tsb.blob("details");
    row = which; rows = [...list];
    id("scene").showModal();
    if (!bev) {
      bev = tsb.sceneBev = new tsb.Bev(id("scene-view"));
      bev.addPlates(tsb.json("plates"));
      bev.onresize = () => { if (box) bev.fit(box, 14); };
    }
    bev.resize();
    await show();
  };
  const step = (by) => {
    const at = rows.indexOf(row) + by;
    if (at >= 0 && at < rows.length) { row = rows[at]; show(); }
  };
  const find = (name) => {
    const { distinct, at } = table.table.values.scenario_id, place = distinct.indexOf(name);
    return place < 0 ? -1 : at.indexOf(place);
  };
  const openNamed = (name) => {
    const found = find(name);
    if (found >= 0) open(found, table.rows.includes(found) ? table.rows : [found]);
  };

  for (const [name, action] of Object.entries({ before: () => step(-1), next: () => step(1), in: () => bev.zoom(1.3),
    out: () => bev.zoom(1 / 1.3), whole: () => bev.fit(box, 14), close: () => id("scene").close() }))
    id(`scene-${name}`).addEventListener("click", action);
  id("scene").addEventListener("close", () => history.replaceState(null, "", "#scenarios"));
  id("scene").addEventListener("keydown", (event) => {
    const keys = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), "+": () => bev.zoom(1.3), "-": () => bev.zoom(1 / 1.3) };
    if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
  });

  const follow = () => {
    const name = new URLSearchParams(location.hash.slice(1)).get("scene");
    if (name) openNamed(name);
  };
  tsb.tableOptions = { "scenario-table": {
    open, label: (which) => table.text("scenario_id", which),
    ready: (api) => {
      table = api;
      for (const link of document.querySelectorAll("[data-filter]"))
        link.addEventListener("click", () => api.filter(JSON.parse(link.dataset.filter)));
      for (const button of document.querySelectorAll("[data-scene]"))
        button.addEventListener("click", () => openNamed(button.dataset.scene));
      addEventListener("hashchange", follow);
      Promise.resolve().then(follow); // when the table has its rows
    },
  } };
})();
