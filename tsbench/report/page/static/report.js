/* A served page of a run that goes on: one line says how far it is, and new episodes appear, but not while an episode plays
 * or a filter is typed. */
(() => {
  const EVERY_MS = 5000, source = tsb.json("source");
  let shown = null;
  const look = async () => {
    const answer = await fetch(source.replace(/data\/$/, "state")), state = answer.ok ? await answer.json() : { status: "" };
    const line = document.getElementById("live"), goesOn = state.status === "running";
    line.hidden = !goesOn;
    line.textContent = `The run goes on: ${state.finished} of ${state.asked} episodes are finished.`;
    shown ??= state.finished;
    const busy = document.querySelector("dialog[open]") || document.activeElement?.matches("input, select");
    if (shown !== state.finished && !busy) location.reload();
    else if (goesOn || busy) setTimeout(look, EVERY_MS);
  };
  if (source !== null) look().catch(() => {}); // the server has ended
})();

/* The report: its table of episodes opens the player, cells of the heat map filter the table. */
tsb.tableOptions = { "episode-table": (() => {
  const playable = (api, row) => api.table.values.playable[row];
  let table = null;
  const name = (row) => `${table.text("planner", row)}/${table.text("scenario_id", row)}`;
  const follow = () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (!asked.has("play")) return;
    for (let row = 0; row < table.table.rows; row++) {
      if (name(row) !== asked.get("play") || !playable(table, row)) continue;
      tsb.player.open(row, table.rows, asked.has("t") ? Number(asked.get("t")) : null);
      return;
    }
  };
  return {
    open: (row, rows) => tsb.player.open(row, [...rows]),
    can: (row) => playable(table, row),
    label: name,
    ready: (api) => {
      table = api;
      tsb.player.name = name;
      tsb.player.who = (row) => api.text("planner", row);
      tsb.player.can = (row) => playable(api, row);
      tsb.player.passed = (row) => api.table.values.scd[row] === true;
      tsb.player.square = (row) => {
        const of = (k) => `${api.text("planner", k)} ${api.text("scenario_id", k).replace(/b?(-c)?$/, "")}`, wanted = of(row), found = [];
        for (let k = 0; k < api.table.rows; k++) if (of(k) === wanted) found.push(k);
        const id = (k) => api.text("scenario_id", k);
        return found.sort((a, b) => (id(a) < id(b) ? -1 : 1));
      };
      tsb.player.rivals = (row) => {
        const scene = api.text("scenario_id", row), found = new Map();
        for (let k = 0; k < api.table.rows; k++)
          if (k !== row && api.text("scenario_id", k) === scene && playable(api, k)) found.set(api.text("planner", k), k);
        return found;
      };
      for (const link of document.querySelectorAll("[data-filter]"))
        link.addEventListener("click", () => api.filter(JSON.parse(link.dataset.filter)));
      addEventListener("hashchange", follow);
      Promise.resolve().then(follow); // when the table has its rows
    },
  };
})() };
