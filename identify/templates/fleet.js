// The pages of a fleet: a table of which only the rows in view exist, a valve's life, a type's spread. No library, no network.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const make = (name, attributes = {}, ...inside) => {
    const drawn = ["svg", "path", "line", "circle", "rect", "text", "polygon"].includes(name);
    const node = drawn ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...inside);
    return node;
  };
  const number = (value, digits = 4) => value === null || value === undefined ? "" : String(Number(value.toPrecision(digits)));

  // A row: grade, type, serial, records, date, hours, verdict, spark, its quantity, what is left, why.
  const [GRADE, TYPE, SERIAL, RECORDS, DATE, HOURS, VERDICT, SPARK, QUANTITY, LEFT, WHY] = Array(11).keys();
  const valves = fleet.valves;
  valves.forEach((valve, i) => { valve.place = i; valve.words = `${valve[TYPE]} ${valve[SERIAL]} ${valve[WHY]}`.toLowerCase(); });
  const leftWords = (left) => !left ? "" : left[1] === 0 ? "reached" : `${number(left[0], 3)} to ${left[1] === null ? "never" : number(left[1], 3)} ${left[2]}`;
  const columns = [
    ["mark", "", (v) => -v[GRADE], (v) => make("div", { class: `mark g${v[GRADE]}` })],
    ["type", "type", (v) => v[TYPE], (v) => v[TYPE]],
    ["serial", "serial", (v) => v[SERIAL], (v) => v[SERIAL]],
    ["number", "records", (v) => -v[RECORDS], (v) => v[RECORDS]],
    ["date", "last test", (v) => v[DATE] ? -Date.parse(v[DATE]) : 0, (v) => v[DATE]],
    ["number", "hours", (v) => -(v[HOURS] ?? -1), (v) => v[HOURS] === null ? "" : Math.round(v[HOURS]).toLocaleString("en")],
    ["verdict", "verdict", (v) => v[VERDICT], (v) => v[VERDICT]],
    ["spark", "course", (v) => v[QUANTITY], (v) => spark(v[SPARK], v[QUANTITY])],
    ["left", "limit in", (v) => v[LEFT]?.[0] ?? Infinity, (v) => leftWords(v[LEFT])],
    ["why", "attention", (v) => v.place, (v) => v[WHY]],
  ];
  const rows = byId("rows"), high = byId("high");
  let shown = valves, sortedBy = null, backwards = false;

  function spark(values, name) {
    const svg = make("svg", { width: 84, height: 22, viewBox: "0 0 84 22" }, make("title", {}, name));
    if (values.length > 1) {
      const low = Math.min(...values), span = Math.max(...values) - low || 1;
      const at = values.map((y, i) => `${2 + 80 * i / (values.length - 1)} ${20 - 18 * (y - low) / span}`);
      svg.append(make("path", { d: "M" + at.join("L"), fill: "none", stroke: "#2f6fb0", "stroke-width": 1.5 }));
    }
    return svg;
  }

  function draw() {
    const tall = parseFloat(getComputedStyle(document.documentElement).getPropertyValue("--high"));
    high.style.height = `${shown.length * tall}px`;
    const first = Math.max(0, Math.floor(rows.scrollTop / tall) - 4), last = first + Math.ceil(rows.clientHeight / tall) + 8;
    high.replaceChildren(...shown.slice(first, last).map((valve, i) => {
      const row = make("div", { class: "row" });
      row.style.top = `${(first + i) * tall}px`;
      for (const [kind, , , cell] of columns) row.append(make("div", { class: `c-${kind} ${kind === "number" ? "number" : ""}` }, cell(valve)));
      row.title = valve[WHY];
      row.onclick = () => { location.hash = `valve/${encodeURIComponent(valve[TYPE])}/${encodeURIComponent(valve[SERIAL])}`; };
      return row;
    }));
  }

  function choose() {
    const words = byId("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const type = byId("type").value, verdict = byId("verdict").value, only = byId("attention").checked;
    shown = valves.filter((v) => (!type || v[TYPE] === type) && (!verdict || v[VERDICT] === verdict) && (!only || v[GRADE] > 0)
      && words.every((word) => v.words.includes(word)));
    if (sortedBy) {
      const key = sortedBy, way = backwards ? -1 : 1;
      shown.sort((a, b) => { const x = key(a), y = key(b); return way * (x < y ? -1 : x > y ? 1 : a.place - b.place); });
    }
    byId("count").textContent = `${shown.length.toLocaleString("en")} of ${valves.length.toLocaleString("en")} valves`;
    rows.scrollTop = 0;
    draw();
  }

  // A picture of a quantity: points with error bars, the line from the last step on with its band, steps, limits.
  function chart(trend, life) {
    const W = 360, H = 200, box = [46, 8, W - 8, H - 26];
    const band = trend.line.map(([t, y, s]) => [t, y - 1.96 * s, y + 1.96 * s]);
    const xs = [...trend.points, ...trend.line].map((p) => p[0]), ys = trend.points.flatMap(([, y, s]) => [y - 1.96 * s, y + 1.96 * s]);
    band.forEach(([, a, b]) => ys.push(a, b));
    const spread = Math.max(...ys) - Math.min(...ys);
    trend.limits.filter((y) => y < Math.max(...ys) + spread && y > Math.min(...ys) - spread).forEach((y) => ys.push(y));
    const scale = (values, from, to) => {
      const low = Math.min(...values), range = Math.max(...values) - low || Math.abs(low) || 1;
      const f = (value) => from + (to - from) * (value - low) / range;
      f.ticks = ticks(low, low + range);
      return f;
    };
    const x = scale(xs, box[0], box[2]), y = scale(ys, box[3], box[1]);
    const inside = (value) => Math.min(Math.max(value, box[1]), box[3]);
    const svg = make("svg", { viewBox: `0 0 ${W} ${H}`, role: "img" });
    for (const t of x.ticks) svg.append(make("text", { x: x(t), y: H - 10, "text-anchor": "middle" }, life.axis === "date" ? number(2000 + t, 6) : number(t)));
    svg.append(make("text", { x: W - 8, y: H - 1, "text-anchor": "end" }, life.axis === "date" ? "year" : "hours"));
    for (const v of y.ticks) svg.append(make("line", { x1: box[0], x2: box[2], y1: y(v), y2: y(v), stroke: "#eee" }),
      make("text", { x: box[0] - 4, y: y(v) + 4, "text-anchor": "end" }, number(v)));
    const edge = [...band.map(([t, a]) => [t, a]), ...band.map(([t, , b]) => [t, b]).reverse()];
    svg.append(make("polygon", { points: edge.map(([t, v]) => `${x(t)},${inside(y(v))}`).join(" "), fill: "#2f6fb0", opacity: 0.15 }));
    svg.append(make("path", { d: "M" + trend.line.map(([t, v]) => `${x(t)} ${inside(y(v))}`).join("L"), stroke: "#2f6fb0", fill: "none" }));
    for (const limit of trend.limits) if (y(limit) >= box[1] - 1 && y(limit) <= box[3] + 1)
      svg.append(make("line", { x1: box[0], x2: box[2], y1: y(limit), y2: y(limit), stroke: "#b00020", "stroke-dasharray": "6 3" }));
    for (const step of life.overhauls) {
      const at = x((step.after + step.before) / 2);
      svg.append(make("line", { x1: at, x2: at, y1: box[1], y2: box[3], stroke: "#777", "stroke-dasharray": "2 3" }));
    }
    for (const [t, v, s] of trend.points) svg.append(
      make("line", { x1: x(t), x2: x(t), y1: inside(y(v - 1.96 * s)), y2: inside(y(v + 1.96 * s)), stroke: "#444" }),
      make("circle", { cx: x(t), cy: y(v), r: 3, fill: "#222" }));
    return svg;
  }

  function ticks(low, high) {
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough), found = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(Number(v.toPrecision(10)));
    return found;
  }

  function histogram(bins, unit) {
    const W = 360, H = 150, most = Math.max(...bins.counts), wide = (W - 16) / bins.counts.length;
    const svg = make("svg", { viewBox: `0 0 ${W} ${H}`, role: "img" });
    bins.counts.forEach((count, i) => {
      const tall = (H - 40) * count / most;
      svg.append(make("rect", { x: 8 + i * wide, y: H - 22 - tall, width: wide - 1, height: tall, fill: "#2f6fb0" }));
    });
    svg.append(make("text", { x: 8, y: H - 6 }, `${number(bins.low)} ${unit}`), make("text", { x: W - 8, y: H - 6, "text-anchor": "end" }, `${number(bins.high)} ${unit}`),
      make("text", { x: W - 8, y: 12, "text-anchor": "end" }, `${most} valves at most`));
    return svg;
  }

  const figure = (title, small, svg) => make("figure", {}, make("figcaption", {}, title, make("small", {}, small)), svg);
  const table = (heads, lines) => make("div", { class: "scroll" }, make("table", {}, make("thead", {}, make("tr", {}, ...heads.map((h) => make("th", {}, h)))),
    make("tbody", {}, ...lines.map((cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)))))));
  const link = (to, words) => make("a", { href: to }, words);

  // Files of lives come as scripts, when they are asked for.
  const lives = {}, waiting = {};
  fleet.lives = (file, content) => { lives[file] = content; (waiting[file] || []).forEach((call) => call()); };
  function withLife(place, call) {
    const file = Math.floor(place / fleet.together), give = () => call(lives[file][place]);
    if (lives[file]) { give(); return; }
    if (!waiting[file]) { waiting[file] = []; document.body.append(make("script", { src: `data/lives-${file}.js` })); }
    waiting[file].push(give);
  }

  function showValve(type, serial) {
    const valve = valves.find((v) => v[TYPE] === type && v[SERIAL] === serial);
    if (!valve) return [make("p", {}, "No such valve in this store.")];
    const here = make("div");
    withLife(valve.place, (life) => {
      const at = (v) => life.axis === "date" ? number(2000 + v, 6) : `${number(v)} h`;
      if (valve[WHY]) here.append(make("ul", { class: "why" }, ...valve[WHY].split("; ").map((why) => make("li", {}, why))));
      for (const step of life.overhauls) here.append(make("p", {},
        `${step.sure ? "Worked on" : "A step, which one more test must confirm,"} between ${at(step.after)} and ${at(step.before)}: ${step.names.join(", ")}`));
      for (const left of life.left) here.append(make("p", {}, `limit of ${left.name}, ${number(left.limit)} ${left.unit}: ` +
        (left.times[0] === null ? "not in a foreseeable time" : left.times[2] === 0 ? "reached" :
          `in ${leftWords([left.times[0], left.times[2], life.per])} from the last record (95 %)`)));
      here.append(make("h2", {}, "Course"), make("div", { class: "charts" }, ...life.trends.map((trend) => figure(trend.unit ? `${trend.name} [${trend.unit}]` : trend.name,
        `${number(trend.rate[0], 3)} ± ${number(trend.rate[1], 2)} per ${life.rated}; its type ${number(trend.rate[2], 3)} ± ${number(trend.rate[3], 2)}`,
        chart(trend, life)))));
      here.append(make("h2", {}, "Records"), table(["date", "hours", "verdict", "gap", "found", "record"], life.records.map((r) => [r.date, number(r.hours, 6),
        r.verdict, number(r.gap, 3), r.found.join(", "), r.report ? link(r.report, r.path) : r.path])));
    });
    return [make("p", { class: "sub" }, link(`#type/${encodeURIComponent(type)}`, `type ${type}`)), here];
  }

  function showType(type) {
    const of = fleet.types[type];
    if (!of) return [make("p", {}, "No such type in this store.")];
    const verdicts = Object.entries(of.verdicts).map(([word, count]) => `${count.toLocaleString("en")} ${word}`).join(", ");
    return [make("p", {}, `${of.valves.toLocaleString("en")} valves; last records: ${verdicts}`),
      make("div", { class: "charts" }, ...of.spread.flatMap((q) => [
        figure(q.name, "at the last record of each valve", histogram(q.level, q.unit)),
        figure(`${q.name} per ${of.rated}`, `the type: ${number(q.type_rate[0], 3)} ± ${number(q.type_rate[1], 2)} ${q.unit}`, histogram(q.rate, q.unit))]))];
  }

  function route() {
    const [what, ...names] = location.hash.slice(1).split("/").map(decodeURIComponent), one = byId("one");
    byId("all").hidden = Boolean(what);
    one.hidden = !what;
    byId("place").textContent = what ? `› ${names.join(" › ") || what}` : "";
    document.title = what ? `${names.join(" ") || what} - Fleet` : "Fleet";
    if (what === "valve") one.replaceChildren(...showValve(names[0], names[1]));
    else if (what === "type") one.replaceChildren(...showType(names[0]));
    else if (what === "types") one.replaceChildren(table(["type", "valves"], Object.entries(fleet.types).map(([type, of]) => [link(`#type/${encodeURIComponent(type)}`, type), String(of.valves)])));
    else if (what === "failures") one.replaceChildren(table(["record", "kind", "why", "tries"], fleet.failures.map((f) => [f.path, f.kind, f.reason, String(f.strikes)])));
    else draw();
    if (what) scrollTo(0, 0);
  }

  columns.forEach(([kind, title, key]) => {
    const head = make("div", { class: kind === "number" ? "number" : "" }, title);
    head.onclick = () => { backwards = sortedBy === key && !backwards; sortedBy = key; choose(); };
    byId("head").append(head);
  });
  for (const [id, column] of [["type", TYPE], ["verdict", VERDICT]])
    for (const word of [...new Set(valves.map((v) => v[column]))].sort()) byId(id).append(make("option", { value: word }, word));
  for (const id of ["search", "type", "verdict", "attention"]) byId(id).addEventListener("input", choose);
  rows.addEventListener("scroll", draw);
  addEventListener("resize", draw);
  addEventListener("hashchange", route);
  const attention = valves.filter((v) => v[GRADE] > 0).length, total = valves.reduce((sum, v) => sum + v[RECORDS], 0);
  byId("summary").textContent = `${valves.length.toLocaleString("en")} valves, ${total.toLocaleString("en")} records; ${attention.toLocaleString("en")} valves need attention`
    + (fleet.undated ? `; ${fleet.undated.toLocaleString("en")} records have no date and no hours` : "");
  byId("failed").textContent = fleet.failures.length ? `${fleet.failures.length.toLocaleString("en")} records without a result` : "";
  byId("made").textContent = fleet.made;
  choose();
  route();
})();
