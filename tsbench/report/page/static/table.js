/* A table with filters, sorting and "show more".
 *
 * table: {columns, rows, values} as page_format.pack_table makes it. A column is {name, label, kind}, and may have
 *   filter: "choice" (a list) or "text" (part of it), digits and unit of numbers, minor: left out on narrow screens,
 *   wide: a text that may be folded, words: [no, yes, unknown] of a flag, marks: a class for each of its texts,
 *   title: what its header means, hidden: it is only for scripts.
 * options: open(row, rows) is called for a row that is opened, can(row) says whether it can be, label(row) names it;
 *   ready(api) gets {filter(values), text(name, row), rows}. */
tsb.table = (host, table, options = {}) => {
  const { el } = tsb, page = 50;
  const text = (column, row) => {
    const value = table.values[column.name];
    if (column.kind === "text") return value.distinct[value.at[row]] ?? "";
    if (column.kind === "flag") return (column.words || ["no", "yes", "–"])[value[row] === null ? 2 : Number(value[row])];
    return value[row] === null ? "" : tsb.number(value[row], column.digits ?? 1);
  };
  const byName = Object.fromEntries(table.columns.map((column) => [column.name, column]));
  const wanted = new Map();
  let order = null, down = false, shown = page, rows = [];

  const controls = el("div", { class: "filters" });
  const folded = el("details", { open: innerWidth > 640, role: "search", "aria-label": `Filter ${host.dataset.label || "rows"}` },
    el("summary", {}, "Filters"), controls);
  const inputs = new Map();
  for (const column of table.columns.filter((c) => c.filter)) {
    const id = `${host.id}-${column.name}`;
    const choices = [...new Set(Array.from({ length: table.rows }, (_, row) => text(column, row)))].filter(Boolean);
    choices.sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
    let input;
    if (column.filter === "choice") {
      input = el("select", { id }, el("option", { value: "" }, "all"), ...choices.map((c) => el("option", { value: c }, c)));
    } else {
      input = el("input", { id, type: "search", list: `${id}-list`, placeholder: "all", autocomplete: "off" });
      controls.append(el("datalist", { id: `${id}-list` }, ...choices.slice(0, 1000).map((c) => el("option", { value: c }))));
    }
    input.addEventListener("input", () => { set(column.name, input.value); });
    inputs.set(column.name, input);
    controls.append(el("label", { for: id }, el("span", {}, column.label), input));
  }
  const reset = el("button", { type: "button", class: "quiet", on: { click: () => filter({}) } }, "clear");
  controls.append(reset);

  const count = el("p", { class: "faint count", role: "status" });
  const head = el("tr");
  if (options.open) head.append(el("th", { scope: "col" }, el("span", { class: "unseen" }, "play")));
  const visible = table.columns.filter((column) => !column.hidden);
  for (const column of visible) {
    const sort = el("button", { type: "button", title: column.title || `sort by ${column.label}`,
      on: { click: () => { down = order === column ? !down : false; order = column; update(); } } }, column.label);
    if (column.unit) sort.append(el("small", {}, ` ${column.unit}`));
    head.append(el("th", { scope: "col", class: cls(column), "data-name": column.name }, sort));
  }
  const body = el("tbody");
  const more = el("button", { type: "button", on: { click: () => { shown += 200; draw(); } } }, "show more");
  const scroll = el("div", { class: "scroll", tabindex: "0" }, el("table", {}, el("thead", {}, head), body));
  host.append(folded, count, scroll, more);

  function cls(column) {
    return [column.kind === "number" ? "number" : "", column.minor ? "minor" : "", column.wide ? "wide" : ""].join(" ").trim();
  }
  function set(name, value) {
    if (value) wanted.set(name, value); else wanted.delete(name);
    update();
  }
  function filter(values) {
    wanted.clear();
    for (const [name, input] of inputs) {
      input.value = values[name] ?? "";
      if (input.value) wanted.set(name, input.value);
    }
    update();
  }
  function update() {
    const tests = [...wanted].map(([name, value]) => {
      const column = byName[name];
      if (column.filter === "choice") return (row) => text(column, row) === value;
      const low = value.toLowerCase();
      return (row) => text(column, row).toLowerCase().includes(low);
    });
    rows = [];
    for (let row = 0; row < table.rows; row++) if (tests.every((test) => test(row))) rows.push(row);
    if (order) {
      const value = table.values[order.name], sign = down ? -1 : 1;
      const key = order.kind === "text" ? (row) => text(order, row) : (row) => (value[row] === null ? -Infinity : Number(value[row]));
      rows.sort((a, b) => { const p = key(a), q = key(b); return sign * (p < q ? -1 : p > q ? 1 : 0) || a - b; });
    }
    for (const cell of head.querySelectorAll("th[data-name]")) {
      const sorted = order && cell.dataset.name === order.name;
      if (sorted) cell.setAttribute("aria-sort", down ? "descending" : "ascending"); else cell.removeAttribute("aria-sort");
    }
    shown = page;
    reset.hidden = wanted.size === 0;
    draw();
  }
  function draw() {
    const some = rows.slice(0, shown);
    body.replaceChildren(...some.map((row) => {
      const line = el("tr");
      if (options.open) {
        const can = !options.can || options.can(row);
        line.append(el("td", {}, can ? el("button", { type: "button", class: "play", "aria-label": `play ${options.label?.(row) ?? "this row"}`,
          on: { click: () => options.open(row, rows) } }, "▶") : ""));
        if (can) line.addEventListener("dblclick", () => options.open(row, rows));
      }
      for (const column of visible) {
        const cell = el("td", { class: cls(column) }, text(column, row));
        const mark = column.marks?.[text(column, row)];
        if (mark) cell.classList.add(mark);
        line.append(cell);
      }
      return line;
    }));
    count.textContent = `${rows.length.toLocaleString("en")} of ${table.rows.toLocaleString("en")} ${host.dataset.label || "rows"}`
      + (some.length < rows.length ? `, the first ${some.length} shown` : "");
    more.hidden = some.length >= rows.length;
  }
  const api = { filter, text: (name, row) => text(byName[name], row), table, get rows() { return rows; } };
  options.ready?.(api);
  update();
  return api;
};
