// What a report's script is made of, and tables as text for a spreadsheet. Both files run as one, in a scope of their own (page.py).
"use strict";
const root = document.documentElement;
const SVG = "http://www.w3.org/2000/svg";
const make = (name, attributes = {}, ...inside) => {
  const drawn = ["svg", "path", "line", "rect", "text", "clipPath", "g", "defs", "circle"].includes(name);
  const node = drawn ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...inside);
  return node;
};
const button = (words, act, attributes = {}) => {
  const node = make("button", { type: "button", ...attributes }, words);
  node.addEventListener("click", act);
  return node;
};
const clean = (value, digits = 5) => String(Number(Number(value).toPrecision(digits)));
const withUnit = (axis, words) => axis.unit ? `${words} ${axis.unit}` : words;
const titled = (axis) => axis.unit ? `${axis.label} [${axis.unit}]` : axis.label;

// ---- tables as text between tabs: what a spreadsheet takes ----
// A number loses the commas between its thousands; a cell that a spreadsheet would run as a formula gets an apostrophe.
function plainCell(text) {
  const words = text.replace(/\s+/g, " ").trim();
  if (/^[+-]?\d{1,3}(,\d{3})+(\.\d+)?$/.test(words)) return words.replace(/,/g, "");
  if (/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?( [\w .,%/°±^-]*)?$/i.test(words)) return words.replace(/^\+/, "");
  return /^[=+\-@]/.test(words) ? `'${words}` : words;
}
async function put(text, from) {
  try { await navigator.clipboard.writeText(text); } catch {
    const area = make("textarea", { class: "unseen", "aria-hidden": "true" });
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const before = from.textContent;
  if (before === "Copied") return;
  from.textContent = "Copied";
  setTimeout(() => { from.textContent = before; }, 1500);
}
const headingBefore = (node) => {
  let found = "";
  for (const heading of document.querySelectorAll("h1, h2")) if (heading.compareDocumentPosition(node) & Node.DOCUMENT_POSITION_FOLLOWING) found = heading.textContent;
  return found.trim();
};
