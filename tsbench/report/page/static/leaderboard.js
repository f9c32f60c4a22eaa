/* Tables whose headers sort: numbers by data-value, other cells by their text. What has no number comes last.
 * Each body of a table is sorted by itself, so floors stay together; a row that heads its body stays first. */
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = tsb.el("button", { type: "button", class: "quiet" }, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") !== "descending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const key = (row) => {
        const cell = row.cells[column], value = cell.dataset.value;
        return value === undefined ? cell.textContent.trim().toLowerCase() : value === "" ? -Infinity : Number(value);
      };
      for (const body of table.tBodies) {
        const rows = [...body.rows].filter((row) => row.className !== "head").sort((a, b) => {
          const x = key(a), y = key(b);
          return (x < y ? -1 : x > y ? 1 : 0) * (down ? -1 : 1);
        });
        body.append(...rows);
      }
    });
  });
}
