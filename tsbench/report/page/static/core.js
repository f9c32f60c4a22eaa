"use strict";
/* What every page needs: elements, themes, data. No text ever becomes markup. */
const tsb = {};

/* An element. attributes: `on` holds listeners; true and false set and leave out. children: elements or texts. */
tsb.el = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") for (const [event, action] of Object.entries(value)) element.addEventListener(event, action);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
};

tsb.number = (value, digits = 1) =>
  value === null || value === undefined ? "–" : Number(value).toLocaleString("en", {
    minimumFractionDigits: digits, maximumFractionDigits: digits });

/* A colour of base.css as the theme has it now, for canvases. */
tsb.colour = (name) => {
  const probe = document.body.appendChild(tsb.el("i", { style: `color:var(${name})` }));
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
};

/* A view's `canvas` takes the pixels of its box; `width` and `height` are in CSS pixels, `ratio` device pixels to one. */
tsb.sizeCanvas = (view) => {
  const ratio = devicePixelRatio || 1, box = view.canvas.getBoundingClientRect();
  view.width = Math.max(box.width, 1);
  view.height = Math.max(box.height, 1);
  view.canvas.width = Math.round(view.width * ratio);
  view.canvas.height = Math.round(view.height * ratio);
  view.ratio = ratio;
};

/* --- themes: as the system has it, or chosen -------------------------------------------------------------------- */
tsb.themed = new Set(); // called when the colours change
(() => {
  const names = ["auto", "light", "dark"], key = "tsbench-theme";
  let theme = "auto";
  // A page from disk may be refused its storage: then the choice lasts as long as the page.
  try { theme = localStorage.getItem(key) || "auto"; } catch { theme = "auto"; }
  if (!names.includes(theme)) theme = "auto";
  const button = document.getElementById("theme");
  const apply = () => {
    document.documentElement.dataset.theme = theme;
    button.textContent = `theme: ${theme}`;
    for (const told of tsb.themed) told();
  };
  button.addEventListener("click", () => {
    theme = names[(names.indexOf(theme) + 1) % names.length];
    try { localStorage.setItem(key, theme); } catch { /* see above */ }
    apply();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", apply);
  apply();
})();

/* --- data ------------------------------------------------------------------------------------------------------- */
tsb.json = (name) => {
  const element = document.querySelector(`script[data-json="${CSS.escape(name)}"]`);
  return element ? JSON.parse(element.textContent) : null;
};

tsb.has = (name) => document.querySelector(`script[data-blob="${CSS.escape(name)}"]`) !== null;

/* A blob: its header, and its arrays under `array`. From the page, or from the server that the page came from. */
tsb.blob = (() => {
  const asked = new Map();
  const bytes = async (name) => {
    const element = document.querySelector(`script[data-blob="${CSS.escape(name)}"]`);
    if (element) return Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
    const source = tsb.json("source");
    if (source === null) throw new Error("not in this page");
    const answer = await fetch(source + name.split("/").map(encodeURIComponent).join("/"));
    if (!answer.ok) throw new Error((await answer.text()).trim() || answer.statusText);
    return new Uint8Array(await answer.arrayBuffer());
  };
  const load = async (name) => {
    const packed = new Blob([await bytes(name)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return tsb.unpack(await new Response(packed).arrayBuffer());
  };
  return (name) => {
    if (!asked.has(name)) {
      if (asked.size > 24) asked.delete(asked.keys().next().value);
      asked.set(name, load(name));
      asked.get(name).catch(() => asked.delete(name)); // asked again, it may be there
    }
    return asked.get(name);
  };
})();

tsb.unpack = (buffer) => {
  const size = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  let at = 4 + size;
  header.array = {};
  for (const [name, kind, length] of header.arrays) {
    if (kind === "i8") {
      header.array[name] = new Int8Array(buffer, at, length);
      at += length;
    } else {
      const low = new Uint8Array(buffer, at, length), high = new Int8Array(buffer, at + length, length);
      header.array[name] = Int16Array.from(low, (byte, k) => byte | (high[k] << 8));
      at += 2 * length;
    }
  }
  return header;
};

/* Undo second differences of pieces of the given lengths (see page_format.py). */
tsb.summed = (second, lengths, unit) => {
  const values = new Float64Array(second.length);
  let at = 0;
  for (const length of lengths) {
    let value = 0, step = 0;
    for (let k = 0; k < length; k++, at++) {
      if (k === 0) value = second[at];
      else { step = k === 1 ? second[at] : step + second[at]; value += step; }
      values[at] = value * unit;
    }
  }
  return values;
};

addEventListener("DOMContentLoaded", () => {
  for (const host of document.querySelectorAll("[data-table]")) {
    tsb.blob(host.dataset.table).then(
      (table) => tsb.table(host, table, tsb.tableOptions?.[host.id] || {}),
      (problem) => host.append(tsb.el("p", { class: "note warn" }, `This table cannot be shown: ${problem.message}`)));
  }
});
