// A report's curves, and what starts the page. No library, no network; without this script the page shows its pictures and tables.
// ---- scales: data to pixels and back; ticks that people count in ----
const BENDS = {
  linear: [(v) => v, (v) => v],
  log: [(v) => v > 0 ? Math.log10(v) : NaN, (v) => 10 ** v],
  symlog: [(v) => Math.asinh(v / 3), (v) => 3 * Math.sinh(v)],
  root: [(v) => Math.sign(v) * Math.sqrt(Math.abs(v)), (v) => Math.sign(v) * v * v],
};
function scale(kind, [low, high], from, to) {
  const [bend, back] = BENDS[kind], a = bend(low), b = bend(high) === a ? a + 1 : bend(high);
  const f = (value) => value === null ? NaN : from + (to - from) * (bend(value) - a) / (b - a);
  f.back = (pixel) => back(a + (b - a) * (pixel - from) / (to - from));
  return f;
}
function linearTicks(low, high, most) {
  const rough = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((m) => m * power >= rough * 0.999) || 10), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k += 1) found.push(Number((k * step).toPrecision(12)));
  return found;
}
function ticks(axis, kind, [low, high], most) {
  if (axis.ticks) { const seen = axis.ticks.filter((v) => v >= low && v <= high); if (seen.length > 2) return seen; }
  if (kind === "log" && low > 0 && high / low > 8) {
    const decades = Math.log10(high / low), inside = decades < 2.2 && most > 5 ? [1, 2, 5] : [1], found = [];
    const every = Math.max(1, Math.ceil(decades / most));
    for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k += 1)
      if (k % every === 0) for (const m of inside) found.push(Number((m * 10 ** k).toPrecision(3)));
    return found.filter((v) => v >= low && v <= high);
  }
  if (kind === "symlog" && Math.max(-low, high) > 20) {
    const found = [0];
    for (let k = 1; 10 ** k <= Math.max(-low, high); k += 1) found.push(10 ** k, -(10 ** k));
    const every = found.length > 2 * most ? 2 : 1;
    return found.filter((v) => v >= low && v <= high && (v === 0 || Math.round(Math.log10(Math.abs(v))) % every === 0));
  }
  return linearTicks(low, high, most);
}

const DASHES = { line: "", dash: "6 4", dot: "2 4", mix: "8 3 2 3" };
const MARKS = [ // of the supply pressures: paths about a point, so large
  (r) => `m${-r},0a${r},${r} 0 1,0 ${2 * r},0a${r},${r} 0 1,0 ${-2 * r},0`, (r) => `m${-r},${-r}h${2 * r}v${2 * r}h${-2 * r}z`,
  (r) => `m0,${-1.3 * r}l${1.3 * r},${1.3 * r}l${-1.3 * r},${1.3 * r}l${-1.3 * r},${-1.3 * r}z`,
  (r) => `m0,${-1.3 * r}l${1.2 * r},${2.1 * r}h${-2.4 * r}z`,
];

// ---- one viewer: the curves of a page's section, one view of them at a time ----
function viewer(holder, number) {
  const views = JSON.parse(holder.querySelector("script").textContent);
  const box = make("div", { class: "viewer" }), tools = make("div", { class: "tools" }), chips = make("div", { class: "chips" });
  const plot = make("div", { class: "plot", tabindex: "0", role: "group" }), tip = make("div", { class: "tip", hidden: "" });
  const said = make("p", { class: "unseen", "aria-live": "polite" }), note = make("p", { class: "note" });
  const empty = make("p", { class: "note", hidden: "" }, "Nothing is shown: switch a trace on.");
  let view, state, drawn = [], x = null, panels = [], cursor = null;
  const states = views.map((one) => ({
    facets: one.facets.map((facet) => facet.values.map((_, i) => !facet.on || facet.on.includes(i))),
    layers: one.layers.map((layer) => layer.shown !== false), x: null, y: {}, log: one.panels.map((panel) => panel.scale),
  }));

  const colourOf = (series, layer) => {
    const c = view.layers[layer].colour ?? (view.colour === null || view.colour === undefined ? -1 : series.at[view.colour]);
    return c < 0 ? "ink" : `c${c}`;
  };
  const paint = (colour) => colour === "ink" ? "var(--ink)" : `var(--${view.palette}${colour.slice(1)})`;
  const seen = (series) => series.at.every((value, i) => state.facets[i][value]);
  const visible = function* (panel = null) {
    for (const series of view.series) if (seen(series))
      for (const draw of series.draw) if (state.layers[draw.layer] && (panel === null || draw.panel === panel)) yield [series, draw];
  };

  function range(axis, kind, values, pad = 0.04) {
    const [bend, back] = BENDS[kind];
    let low = Infinity, high = -Infinity;
    const take = (v) => { if (v === null || v === undefined) return; const b = bend(v); if (Number.isFinite(b)) { low = Math.min(low, b); high = Math.max(high, b); } };
    values(take);
    (axis.include || []).forEach(take);
    if (low > high) return kind === "log" ? [1, 10] : [-1, 1];
    const air = pad * (high - low) || 0.05 * Math.abs(low) || 1;
    return [back(low - air), back(high + air)];
  }
  const wholeX = () => range(view.x, view.x.scale, (take) => {
    for (const [series, draw] of visible()) { series.x.forEach(take); if (draw.x2) draw.x2.forEach(take); if (view.layers[draw.layer].kind === "bar") take(0); }
  }, view.panels[0].names ? 0.04 : 0.015);
  function wholeY(index, [low, high]) {
    const panel = view.panels[index];
    if (panel.names) return [panel.names.length - 0.4, -0.6];
    const found = range(panel, state.log[index], (take) => {
      for (const [series, draw] of visible(index)) series.x.forEach((v, i) => {
        if (v >= low && v <= high) { take(draw.y[i]); if (draw.y2) take(draw.y2[i]); }
      });
    });
    return found;
  }

  function render() {
    const W = Math.max(plot.clientWidth, 240), narrow = W < 520, names = view.panels[0].names;
    const xr = state.x || wholeX(), font = 7;
    const yr = view.panels.map((_, i) => state.y[i] || wholeY(i, xr));
    const tall = view.panels.map((panel) => panel.names ? Math.max(panel.names.length * 24 + 10, 80) : Math.round((panel.tall || 1) * (narrow ? 230 : 300)));
    const yt = view.panels.map((panel, i) => panel.names ? [] : ticks(panel, state.log[i], yr[i], tall[i] / 42));
    const short = (words) => narrow && words.length > 19 ? `${words.slice(0, 18)}…` : words;
    const labels = names ? names.map(short) : yt.flat().map((v) => clean(v));
    const left = Math.min(14 + font * Math.max(3, ...labels.map((word) => word.length)), 0.5 * W), right = W - 10;
    x = scale(view.x.scale, xr, left, right);
    const svg = make("svg", { width: W, role: "img", "aria-label": `${view.title}: ${view.panels.map((p) => titled(p)).join("; ")} over ${titled(view.x)}` });
    const xt = ticks(view.x, view.x.scale, xr, (right - left) / 80);
    let top = 0;
    panels = view.panels.map((panel, i) => {
      top += 24;
      const y = scale(panel.names ? "linear" : state.log[i], yr[i], top + tall[i], top), id = `clip-${number}-${i}`;
      svg.append(make("text", { x: panel.names ? 4 : Math.max(left - 50, 4), y: top - 8, class: "title" }, titled(panel)));
      svg.append(make("defs", {}, make("clipPath", { id }, make("rect", { x: left, y: top, width: right - left, height: tall[i] }))));
      for (const v of xt) svg.append(make("line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: top + tall[i] }));
      for (const v of yt[i]) svg.append(make("line", { class: "grid", x1: left, x2: right, y1: y(v), y2: y(v) }),
        make("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, clean(v)));
      if (panel.names) panel.names.forEach((name, row) => svg.append(make("text", { x: left - 6, y: y(row) + 4, "text-anchor": "end" }, make("title", {}, name), short(name))));
      const inside = make("g", { "clip-path": `url(#${id})` });
      for (const rule of panel.rules || []) inside.append(Array.isArray(rule)
        ? make("rect", { class: "zone", x: left, width: right - left, y: Math.min(y(rule[0]), y(rule[1])), height: Math.abs(y(rule[0]) - y(rule[1])) })
        : make("line", { class: "rule", x1: left, x2: right, y1: y(rule), y2: y(rule) }));
      if (names && xr[0] < 0 && xr[1] > 0) inside.append(make("line", { class: "rule", x1: x(0), x2: x(0), y1: top, y2: top + tall[i] }));
      for (const wanted of ["band", "bar", "interval", "points", "line"]) for (const [series, draw] of visible(i))
        if (view.layers[draw.layer].kind === wanted) trace(inside, series, draw, y);
      svg.append(inside, make("line", { class: "axis", x1: left, x2: right, y1: top + tall[i], y2: top + tall[i] }));
      const done = { top, bottom: top + tall[i], y, inside, kind: state.log[i] };
      top += tall[i];
      return done;
    });
    for (const v of xt) svg.append(make("text", { x: x(v), y: top + 17, "text-anchor": "middle" }, clean(v)));
    svg.append(make("text", { x: right, y: top + 36, "text-anchor": "end", class: "title" }, titled(view.x)));
    svg.setAttribute("height", top + 42);
    plot.querySelector("svg")?.remove();
    plot.prepend(svg);
    plot.setAttribute("aria-label", `${view.title}. Arrow keys read the curves point by point, + and - zoom, 0 shows all.`);
    empty.hidden = !visible().next().done;
    panels.left = left; panels.right = right;
    point(null);
  }

  function trace(inside, series, draw, y) {
    const layer = view.layers[draw.layer], colour = colourOf(series, draw.layer), px = series.x.map(x), py = draw.y.map(y);
    const put = (d, attributes) => d && inside.append(make("path", { d, ...attributes }));
    const good = (i) => Number.isFinite(px[i]) && Number.isFinite(py[i]);
    const at = (i) => `${px[i].toFixed(1)},${py[i].toFixed(1)}`;
    if (layer.kind === "line") {
      let d = "", on = false;
      for (let i = 0; i < px.length; i += 1) { if (good(i)) { d += (on ? "L" : "M") + at(i); on = true; } else on = false; }
      put(d, { class: "curve", style: `stroke:${paint(colour)}`, "stroke-dasharray": DASHES[layer.dash || "line"] });
    } else if (layer.kind === "band") {
      const upper = draw.y2.map(y), keep = px.map((_, i) => i).filter((i) => good(i) && Number.isFinite(upper[i]));
      if (keep.length) put("M" + [...keep.map(at), ...keep.reverse().map((i) => `${px[i].toFixed(1)},${upper[i].toFixed(1)}`)].join("L") + "Z", { class: "band", style: `fill:${paint(colour)}` });
    } else if (layer.kind === "points") {
      const crowd = px.length > 400 ? 2.2 : 3.2, mark = MARKS[view.mark === undefined || view.mark === null ? 0 : series.at[view.mark] % MARKS.length](crowd);
      const hollow = layer.hollow || (view.hollow !== undefined && view.hollow !== null && series.at[view.hollow] === 1);
      let d = "";
      for (let i = 0; i < px.length; i += 1) if (good(i)) d += `M${at(i)}${mark}`;
      put(d, { class: hollow ? "points hollow" : "points", style: `stroke:${paint(colour)};fill:${hollow ? "var(--paper)" : paint(colour)}` });
    } else {
      const end = draw.x2 ? draw.x2.map(x) : px.map(() => x(0)), high = layer.kind === "bar" ? 8 : layer.wide ? 5 : 1.3;
      let d = "";
      for (let i = 0; i < px.length; i += 1) if (good(i) && Number.isFinite(end[i]))
        d += `M${Math.min(px[i], end[i]).toFixed(1)},${(py[i] - high).toFixed(1)}h${Math.max(Math.abs(end[i] - px[i]), 0.5).toFixed(1)}v${2 * high}h${-Math.max(Math.abs(end[i] - px[i]), 0.5).toFixed(1)}z`;
      put(d, { class: layer.faint ? "bar faint" : "bar", style: `fill:${paint(colour)}` });
    }
  }

  // What a point says: its place, the values of all traces there, and under which conditions.
  function words(series, i) {
    const lines = [], names = view.panels[0].names;
    if (names) lines.push(names[series.draw[0].y[i]]);
    else lines.push(`${view.x.label} ${withUnit(view.x, clean(series.x[i]))}`);
    for (const draw of series.draw) if (state.layers[draw.layer]) {
      const layer = view.layers[draw.layer], panel = view.panels[draw.panel];
      if (draw.words) { if (draw.words[i]) lines.push(draw.words[i]); continue; }
      if (names) { lines.push(`${layer.name} ${draw.x2 ? `${clean(series.x[i], 4)} to ` : ""}${withUnit(view.x, clean(draw.x2 ? draw.x2[i] : series.x[i], 4))}`); continue; }
      if (draw.y[i] === null) continue;
      const value = layer.kind === "band" ? `${clean(draw.y[i])} to ${clean(draw.y2[i])}` : clean(draw.y[i]);
      lines.push(`${view.panels.length > 1 && !draw.plain ? `${panel.label}, ` : ""}${layer.name} ${withUnit(panel, value)}`);
    }
    const where = view.facets.map((facet, k) => facet.values[series.at[k]]).filter(Boolean);
    if (where.length) lines.push(where.join(", "));
    return lines;
  }

  function point(found) {
    plot.querySelector(".ring")?.remove();
    tip.hidden = !found;
    cursor = found;
    if (!found) return;
    const { series, draw, i } = found, y = panels[draw.panel].y, cx = x(series.x[i]), cy = y(draw.y[i]);
    plot.querySelector("svg").append(make("circle", { class: "ring", cx, cy, r: 6 }));
    tip.replaceChildren(...words(series, i).map((line, k) => make(k ? "div" : "b", {}, line)));
    const W = plot.clientWidth, wide = tip.offsetWidth;
    tip.style.left = `${Math.max(0, Math.min(W - wide, cx > W / 2 ? cx - wide - 14 : cx + 14))}px`;
    tip.style.top = `${Math.max(0, cy - tip.offsetHeight - 10)}px`;
  }

  function nearest(mx, my) {
    const panel = panels.findIndex((p) => my >= p.top - 4 && my <= p.bottom + 4);
    if (panel < 0) return null;
    let best = null, least = 40 * 40;
    for (const [series, draw] of visible(panel)) for (let i = 0; i < series.x.length; i += 1) {
      const dx = x(series.x[i]) - mx;
      if (dx * dx >= least && !draw.x2) continue;
      const span = draw.x2 || view.layers[draw.layer].kind === "bar" ? [x(series.x[i]), draw.x2 ? x(draw.x2[i]) : x(0)].sort((a, b) => a - b) : null;
      const off = span ? Math.max(span[0] - mx, 0, mx - span[1]) : dx, dy = panels[panel].y(draw.y[i]) - my, d = off * off + dy * dy;
      if (d < least && x(series.x[i]) >= panels.left - 1 && x(series.x[i]) <= panels.right + 1) { least = d; best = { series, draw, i }; }
    }
    return best;
  }

  // ---- zoom: in pixels, so that it is the same on every scale ----
  function zoomX(factor, about = (panels.left + panels.right) / 2) {
    state.x = [x.back(about - (about - panels.left) * factor), x.back(about + (panels.right - about) * factor)];
    const whole = wholeX();
    state.x = [Math.max(state.x[0], whole[0]), Math.min(state.x[1], whole[1])];
    if (state.x[0] <= whole[0] && state.x[1] >= whole[1]) state.x = null;
    state.y = {};
    changed();
  }
  function shift(pixels) {
    if (!state.x) return;
    const whole = wholeX(), moved = [x.back(panels.left - pixels), x.back(panels.right - pixels)];
    if (moved[0] >= whole[0] && moved[1] <= whole[1]) { state.x = moved; changed(); }
  }
  const reset = () => { state.x = null; state.y = {}; changed(); };
  function changed() { render(); whole.disabled = !state.x && !Object.keys(state.y).length; }

  const touches = new Map();
  let start = null, frame = null;
  const place = (event) => { const r = plot.getBoundingClientRect(); return [event.clientX - r.left, event.clientY - r.top]; };
  plot.addEventListener("pointerdown", (event) => {
    const [mx, my] = place(event);
    touches.set(event.pointerId, [mx, my]);
    plot.setPointerCapture(event.pointerId);
    start = { mx, my, panel: panels.findIndex((p) => my >= p.top && my <= p.bottom), last: mx };
    if (event.pointerType === "touch") { if (touches.size === 1) point(nearest(mx, my)); return; }
    if (event.button === 0 && start.panel >= 0) { frame = make("rect", { class: "frame" }); plot.querySelector("svg").append(frame); }
  });
  plot.addEventListener("pointermove", (event) => {
    const [mx, my] = place(event);
    if (touches.has(event.pointerId) && event.pointerType === "touch") {
      const before = [...touches.values()];
      touches.set(event.pointerId, [mx, my]);
      const after = [...touches.values()];
      if (after.length === 2) {
        const apart = (two) => Math.max(Math.abs(two[0][0] - two[1][0]), 20);
        zoomX(apart(before) / apart(after), (after[0][0] + after[1][0]) / 2);
      } else if (state.x) { shift(mx - start.last); start.last = mx; } else point(nearest(mx, my));
      return;
    }
    if (frame) {
      point(null);
      const p = panels[start.panel], flat = Math.abs(my - start.my) < 12 || view.panels[0].names;
      const a = Math.max(Math.min(mx, start.mx), panels.left), b = Math.min(Math.max(mx, start.mx), panels.right);
      const c = flat ? p.top : Math.max(Math.min(my, start.my), p.top), d = flat ? p.bottom : Math.min(Math.max(my, start.my), p.bottom);
      for (const [key, value] of Object.entries({ x: a, width: Math.max(b - a, 0), y: c, height: Math.max(d - c, 0) })) frame.setAttribute(key, value);
      start.box = [a, b, c, d, flat];
    } else if (!touches.size) point(nearest(mx, my));
  });
  const lift = (event) => {
    touches.delete(event.pointerId);
    if (!frame) return;
    frame.remove();
    frame = null;
    const drawnBox = start.box;
    if (!drawnBox || event.type === "pointercancel" || drawnBox[1] - drawnBox[0] < 8) return;
    const [a, b, c, d, flat] = drawnBox, y = panels[start.panel].y;
    const chosen = [x.back(a), x.back(b)];
    state.y = flat ? {} : { [start.panel]: [y.back(d), y.back(c)] };
    state.x = chosen;
    changed();
  };
  plot.addEventListener("pointerup", lift);
  plot.addEventListener("pointercancel", lift);
  plot.addEventListener("pointerleave", () => { if (!touches.size) point(null); });
  plot.addEventListener("dblclick", reset);
  plot.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    zoomX(event.deltaY > 0 ? 1.25 : 0.8, place(event)[0]);
  }, { passive: false });
  plot.addEventListener("keydown", (event) => {
    if (event.target !== plot) return;
    const step = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (event.key === "+" || event.key === "=") zoomX(0.7);
    else if (event.key === "-") zoomX(1 / 0.7);
    else if (event.key === "0" || event.key === "Escape") reset();
    else if (step) {
      const shown = [...visible()].filter(([series]) => series.x.length);
      if (!shown.length) return;
      let k = cursor ? shown.findIndex(([series, draw]) => series === cursor.series && draw === cursor.draw) : 0, i = cursor ? cursor.i : -1;
      if (event.key.endsWith("Up") || event.key.endsWith("Down")) { k = (Math.max(k, 0) + step + shown.length) % shown.length; i = Math.max(i, 0); } else i += step;
      const [series, draw] = shown[Math.max(k, 0)];
      point({ series, draw, i: Math.min(Math.max(i, 0), series.x.length - 1) });
      said.textContent = words(series, cursor.i).join("; ");
    } else return;
    event.preventDefault();
  });

  // ---- what can be switched on and off ----
  function chip(parent, label, list, i, swatch) {
    const node = button(label, () => {
      list[i] = !list[i];
      if (!list.some(Boolean)) list.fill(true);
      [...parent.querySelectorAll("button")].forEach((one, k) => one.setAttribute("aria-pressed", list[k]));
      changed();
    }, { class: "chip", "aria-pressed": list[i] });
    if (swatch) node.prepend(swatch);
    parent.append(node);
  }
  function group(words) {
    const node = make("div", { class: "group", role: "group", "aria-label": words }, make("span", { class: "of" }, words));
    chips.append(node);
    return node;
  }
  function swatch(layer, colour) {
    const svg = make("svg", { width: 22, height: 12, "aria-hidden": "true" }), fill = colour ? paint(colour) : "var(--ink)";
    if (layer.kind === "line") svg.append(make("line", { x1: 1, x2: 21, y1: 6, y2: 6, class: "curve", style: `stroke:${fill}`, "stroke-dasharray": DASHES[layer.dash || "line"] }));
    else if (layer.kind === "points") svg.append(make("circle", { cx: 11, cy: 6, r: 3.5, style: `stroke:${fill};fill:${layer.hollow ? "var(--paper)" : fill}` }));
    else svg.append(make("rect", { x: 1, width: 20, y: layer.kind === "interval" && !layer.wide ? 5 : 2, height: layer.kind === "interval" && !layer.wide ? 2.5 : 8, class: layer.kind === "band" ? "band" : layer.faint ? "bar faint" : "bar", style: `fill:${fill}` }));
    return svg;
  }
  const picture = button("Picture", () => {
    const on = holder.classList.toggle("as-picture");
    picture.setAttribute("aria-pressed", on);
    if (on) dispatchEvent(new Event("resize"));
    else render();
  }, { "aria-pressed": "false" });
  const whole = button("Show all", reset, { disabled: "" });
  const log = button("Logarithmic", () => {
    view.panels.forEach((panel, i) => { if (panel.log) state.log[i] = state.log[i] === "log" ? "linear" : "log"; });
    log.setAttribute("aria-pressed", state.log.some((kind, i) => view.panels[i].log && kind === "log"));
    state.y = {};
    changed();
  });
  const copy = button("Copy data", () => {
    const seenLayers = view.layers.filter((layer, i) => state.layers[i] && layer.kind !== "band");
    const rows = [[...view.facets.map((facet) => facet.name), titled(view.x), ...view.panels.flatMap((panel, p) => seenLayers
      .filter((layer) => view.series.some((s) => s.draw.some((d) => d.panel === p && view.layers[d.layer] === layer)))
      .map((layer) => `${layer.name}, ${titled(panel)}`))]];
    const columns = view.panels.flatMap((_, p) => seenLayers.filter((layer) => view.series.some((s) => s.draw.some((d) => d.panel === p && view.layers[d.layer] === layer))).map((layer) => [p, layer]));
    for (const series of view.series) if (seen(series)) series.x.forEach((value, i) => rows.push([
      ...series.at.map((k, f) => plainCell(view.facets[f].values[k])), value,
      ...columns.map(([p, layer]) => series.draw.find((d) => d.panel === p && view.layers[d.layer] === layer)?.y[i] ?? "")]));
    put(rows.map((row) => row.join("\t")).join("\n"), copy);
  });

  function open(index) {
    view = views[index];
    state = states[index];
    chips.replaceChildren();
    view.facets.forEach((facet, f) => {
      if (facet.values.length < 2) return;
      const parent = group(facet.name);
      facet.values.forEach((value, i) => chip(parent, value, state.facets[f], i, f === view.colour ? swatch({ kind: "line" }, `c${i}`) : null));
    });
    if (view.layers.length > 1) {
      const parent = group("traces");
      view.layers.forEach((layer, i) => chip(parent, layer.name, state.layers, i, swatch(layer, layer.colour === undefined || layer.colour === null ? null : layer.colour < 0 ? "ink" : `c${layer.colour}`)));
    }
    log.hidden = !view.panels.some((panel) => panel.log);
    log.setAttribute("aria-pressed", state.log.some((kind, i) => view.panels[i].log && kind === "log"));
    copy.hidden = Boolean(view.panels[0].names);
    note.textContent = view.note || "";
    changed();
  }

  if (views.length > 1) {
    const choice = make("select", {}, ...views.map((one, i) => make("option", { value: i }, one.title)));
    choice.addEventListener("input", () => open(Number(choice.value)));
    tools.append(make("label", { class: "choice" }, `${holder.dataset.choice || "Show"} `, choice));
  } else tools.append(make("b", { class: "choice" }, views[0].title));
  if (holder.querySelector("img") === null) picture.hidden = true;
  tools.append(button("+", () => zoomX(0.6), { "aria-label": "zoom in", title: "zoom in; or drag over the curves, pinch, Ctrl and wheel" }),
    button("−", () => zoomX(1 / 0.6), { "aria-label": "zoom out", title: "zoom out" }), whole, log, copy, picture);
  plot.append(tip);
  box.append(tools, chips, plot, empty, note, said);
  holder.prepend(box);
  open(0);
  let wide = plot.clientWidth;
  new ResizeObserver(() => { if (plot.clientWidth && plot.clientWidth !== wide) { wide = plot.clientWidth; render(); } }).observe(plot);
}

// ---- the page ----
root.classList.add("scripted");
document.querySelectorAll(".curves").forEach(viewer);
document.querySelectorAll(".scroll").forEach((box, i) => {
  const name = headingBefore(box), table = box.querySelector("table");
  box.setAttribute("aria-label", `table ${i + 1}: ${name}`);
  const text = () => [...table.rows].map((row) => [...row.cells].map((cell) => plainCell(cell.textContent)).join("\t")).join("\n");
  box.before(make("div", { class: "above" }, button("Copy table", (event) => put(text(), event.target), { class: "small", "aria-label": `Copy table: ${name}` })));
});
// Where a picture is wider than a phone it scrolls, with keys too.
const reach = () => document.querySelectorAll("figure").forEach((one) => { if (one.scrollWidth > one.clientWidth) one.tabIndex = 0; else one.removeAttribute("tabindex"); });
addEventListener("resize", reach);
reach();
document.querySelectorAll("code.command").forEach((code) => code.parentNode.after(make("div", { class: "above" },
  button("Copy command", (event) => put(code.textContent, event.target), { class: "small" }))));

const dark = () => (root.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
const theme = button("", () => { root.dataset.theme = dark() ? "light" : "dark"; name(); }, { class: "theme" });
const name = () => { theme.textContent = dark() ? "Light" : "Dark"; theme.setAttribute("aria-label", `${dark() ? "light" : "dark"} page`); };
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", name);
name();
document.querySelector("header").prepend(theme);
