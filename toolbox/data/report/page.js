// What a report does in a browser: tables that are sorted and unfolded, a map, a view in space.
// Without this script, or without WebGL, the pictures and all rows are there all the same.
"use strict";
(() => {
  const words = JSON.parse(document.getElementById("words")?.textContent ?? "{}"), word = (text) => words[text] ?? text;
  const comma = document.documentElement.lang !== "en", decimals = (text) => comma ? `${text}`.replace(".", ",") : text;
  document.documentElement.classList.add("js");
  const make = (tag, set = {}, ...inside) => {
    const made = Object.assign(document.createElement(tag), set);
    made.append(...inside);
    return made;
  };

  // Tables -------------------------------------------------------------------------------------
  const value = (row, column, number) => {
    const text = row.cells[column].textContent.trim();
    return number ? (text === "" ? NaN : parseFloat(text.replace(",", ".").replace(/^(< |\D+\. )/, ""))) : text;
  };
  const sort = (table, column, head) => {
    const up = head.getAttribute("aria-sort") !== "ascending", number = head.classList.contains("number");
    const body = table.tBodies[0], unfolded = [...body.rows].map((row) => row.classList.contains("more"));
    const rows = [...body.rows].map((row) => [value(row, column, number), row]);
    rows.sort(([a], [b]) => {
      if (number && (isNaN(a) || isNaN(b))) return isNaN(a) - isNaN(b); // what is missing comes last
      return (up ? 1 : -1) * (number ? a - b : a.localeCompare(b, "en", { numeric: true }));
    });
    rows.forEach(([, row], place) => { row.classList.toggle("more", unfolded[place]); body.append(row); });
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
  };
  for (const table of document.querySelectorAll("main .table:not(.on-paper) table")) {
    if (!table.tHead || table.tBodies[0].rows.length < 2) continue;
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = make("button", { type: "button", title: word("Sort by this column") });
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => sort(table, column, head));
    });
  }
  for (const button of document.querySelectorAll(".unfold"))
    button.addEventListener("click", () => button.closest(".folded").classList.remove("folded"));

  // Folded sections are on paper, too; a browser prints none that is closed.
  let opened = [];
  addEventListener("beforeprint", () => { opened = [...document.querySelectorAll("details:not([open])")]; for (const one of opened) one.open = true; });
  addEventListener("afterprint", () => { for (const one of opened) one.open = false; });

  // A feature that was asked for: its row, and its texts beside the map --------------------------
  const choose = (row, box) => {
    for (const old of document.querySelectorAll("tr.chosen")) old.classList.remove("chosen");
    row.classList.add("chosen");
    const heads = row.closest("table").tHead.rows[0].cells, list = make("dl");
    [...row.cells].forEach((cell, place) => {
      const text = cell.textContent.trim();
      if (text) list.append(make("div", {}, make("dt", { textContent: heads[place].textContent.trim() }), make("dd", { textContent: text })));
    });
    box.replaceChildren(make("strong", { textContent: row.closest("section").querySelector("h2").textContent }), list);
    box.hidden = false;
  };

  // plotly.js, packed in this file ------------------------------------------------------------
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  let library = null;
  const plotly = () => library ??= (async () => {
    const packed = new Blob([bytes(document.getElementById("library").textContent)]);
    const text = await new Response(packed.stream().pipeThrough(new DecompressionStream("gzip"))).text();
    document.head.append(make("script", { textContent: text }));
    if (!window.Plotly) throw new Error("plotly.js did not start");
    return window.Plotly;
  })();
  const LOOK = { displaylogo: false, responsive: true, scrollZoom: true, displayModeBar: false };
  const FONT = { family: "system-ui, sans-serif", size: 12, color: "#1f2328" };

  const board = (figure, label) => {
    const canvas = make("div", { className: "canvas", tabIndex: 0 });
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", label);
    const tools = make("div", { className: "tools" }), asked = make("div", { className: "asked", hidden: true });
    asked.setAttribute("aria-live", "polite");
    const whole = make("div", { className: "board" }, canvas);
    figure.prepend(tools, whole, asked);
    const button = (text, title, action) => {
      const made = make("button", { type: "button", textContent: text, title });
      made.setAttribute("aria-label", title);
      made.addEventListener("click", action);
      tools.append(made);
    };
    const keys = (actions) => canvas.addEventListener("keydown", (event) => {
      const action = actions[event.key];
      if (action) { action(); event.preventDefault(); }
    });
    return { canvas, tools, asked, whole, button, keys };
  };

  // Map ----------------------------------------------------------------------------------------
  const flat = (data, parts) => {
    const x = [], y = [];
    for (const part of parts) {
      if (x.length) { x.push(null); y.push(null); }
      for (let k = 0; k < part.length; k += 2) { x.push(data.x0 + part[k]); y.push(data.y0 + part[k + 1]); }
    }
    return { x, y };
  };
  const traceOf = (data, layer, group) => {
    const all = flat(data, group.features.flatMap(([, parts]) => parts));
    const made = { type: "scatter", name: group.name, visible: layer.hidden ? "legendonly" : true, legendgroup: layer.name, legendgrouptitle: { text: layer.name }, hoverinfo: "skip", ...all };
    if (group.shape === "point") return { ...made, mode: "markers", marker: { size: group.features.length > 500 ? 5 : 9, color: group.colour, line: { width: 1, color: "#fff" } } };
    const line = { color: group.colour, width: group.thin ? 1 : 2 };
    if (group.shape === "line" || group.open) return { ...made, mode: "lines", line };
    return { ...made, mode: "lines", line, fill: "toself", fillcolor: group.colour + "66" };
  };
  const keyOf = (key) => {
    const list = make("ul", { className: "key" });
    if (!key) return list;
    if (key.ramp) {
      const ramp = make("i", { className: "ramp" });
      ramp.style.background = `linear-gradient(to right, ${key.ramp.join(",")})`;
      list.append(make("li", {}, key.low, " ", ramp, " ", `${key.high}  ${key.label}`));
    } else for (const [name, colour] of key.classes) {
      const box = make("i");
      box.style.background = colour;
      list.append(make("li", {}, box, name));
    }
    return list;
  };
  const round = (length) => {
    const power = 10 ** Math.floor(Math.log10(length));
    return [5, 2, 1].find((f) => f * power <= length) * power;
  };
  const within = (parts, x, y) => { // whether a place is in an area, by the even-odd rule
    let inside = false;
    for (const part of parts) for (let k = 0, j = part.length - 2; k < part.length; j = k, k += 2)
      if ((part[k + 1] > y) !== (part[j + 1] > y) && x < (part[j] - part[k]) * (y - part[k + 1]) / (part[j + 1] - part[k + 1]) + part[k]) inside = !inside;
    return inside;
  };
  const away = (parts, x, y, open) => { // how far a place is from the nearest corner or edge
    let least = Infinity;
    for (const part of parts) for (let k = 0; k < part.length; k += 2) {
      const ax = part[k], ay = part[k + 1], more = !open && k + 2 < part.length;
      const dx = more ? part[k + 2] - ax : 0, dy = more ? part[k + 3] - ay : 0, length = dx * dx + dy * dy;
      const t = length ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / length, 0), 1) : 0;
      least = Math.min(least, Math.hypot(x - ax - t * dx, y - ay - t * dy));
    }
    return least;
  };
  const drawMap = async (figure, data) => {
    const Plotly = await plotly();
    const { canvas, tools, asked, whole, button, keys } = board(figure, word("Map. Arrow keys move it, plus and minus zoom, 0 shows all."));
    const [west, south, east, north] = data.bounds;
    if (north - south > 1.3 * (east - west)) canvas.style.height = "88vh";
    const axis = { zeroline: false, showgrid: false, ticks: "outside", tickformat: "d", exponentformat: "none", nticks: 5, tickfont: { size: 10 }, title: { font: { size: 11 } } };
    const image = (base) => base ? [{ source: base.source, xref: "x", yref: "y", layer: "below", sizing: "stretch", x: data.x0 + base.bounds[0], y: data.y0 + base.bounds[3], sizex: base.bounds[2] - base.bounds[0], sizey: base.bounds[3] - base.bounds[1] }] : [];
    const groups = data.layers.flatMap((layer) => layer.groups.map((group) => [layer, group]));
    const traces = groups.map(([layer, group]) => traceOf(data, layer, group));
    for (const { texts = [] } of data.layers) if (texts.length) // numbers, as tables have them
      traces.push({ type: "scatter", mode: "text", x: texts.map(([x]) => data.x0 + x), y: texts.map(([, y]) => data.y0 + y), text: texts.map(([, , text]) => `<b>${text}</b>`), textfont: { color: "#1f2328", shadow: "0 0 3px #fff, 0 0 3px #fff" }, showlegend: false, hoverinfo: "skip" });
    traces.push({ type: "scatter", x: [null], y: [null], mode: "markers+lines", showlegend: false, hoverinfo: "skip", line: { color: "#ffd400", width: 5 }, marker: { size: 18, color: "rgba(0,0,0,0)", line: { color: "#ffd400", width: 4 } } });
    if (traces.length === 1) traces.unshift({ type: "scatter", x: [data.x0 + west, data.x0 + east], y: [data.y0 + south, data.y0 + north], mode: "none", showlegend: false, hoverinfo: "skip" });
    const phone = innerWidth < 640;
    const layout = {
      font: FONT, separators: comma ? ",." : ".,", dragmode: "pan", margin: { l: phone ? 8 : 58, r: 8, t: 8, b: phone ? 8 : 38 }, paper_bgcolor: "#fff", plot_bgcolor: "#e9edf1", images: image(data.bases[0]),
      xaxis: { ...axis, visible: !phone, range: [data.x0 + west, data.x0 + east], title: { text: data.axes[0], font: { size: 11 } } },
      yaxis: { ...axis, visible: !phone, range: [data.y0 + south, data.y0 + north], scaleanchor: "x", title: { text: data.axes[1], font: { size: 11 } }, tickangle: -90 },
      legend: phone ? { orientation: "h", y: -0.02, yanchor: "top" } : { x: 1.01, xanchor: "left", y: 1, groupclick: "toggleitem" },
    };
    await Plotly.newPlot(canvas, traces, layout, LOOK);
    figure.classList.add("drawn");
    const axes = () => [canvas._fullLayout.xaxis, canvas._fullLayout.yaxis];
    const move = (right, up, zoom = 1) => {
      const change = {};
      axes().forEach(({ range: [low, high] }, side) => {
        const middle = (+low + +high) / 2 + [right, up][side] * (high - low), half = (high - low) / 2 * zoom;
        change[["xaxis", "yaxis"][side] + ".range"] = [middle - half, middle + half];
      });
      return Plotly.relayout(canvas, change);
    };
    const all = () => Plotly.relayout(canvas, { "xaxis.range": [data.x0 + west, data.x0 + east], "yaxis.range": [data.y0 + south, data.y0 + north] });
    button("+", word("Zoom in"), () => move(0, 0, 0.5));
    button("−", word("Zoom out"), () => move(0, 0, 2));
    button(word("Show all"), word("Show all"), all);
    keys({ ArrowLeft: () => move(-0.2, 0), ArrowRight: () => move(0.2, 0), ArrowUp: () => move(0, 0.2), ArrowDown: () => move(0, -0.2), "+": () => move(0, 0, 0.5), "-": () => move(0, 0, 2), 0: all });
    let key = keyOf(data.bases[0]?.key);
    whole.after(key);
    if (data.bases.length) {
      const select = make("select", {}, ...data.bases.map((base, place) => make("option", { value: place, textContent: base.name })), make("option", { value: -1, textContent: word("nothing") }));
      select.addEventListener("change", () => {
        const base = data.bases[select.value], next = keyOf(base?.key);
        key.replaceWith(next);
        key = next;
        Plotly.relayout(canvas, { images: image(base) });
      });
      tools.append(make("label", {}, word("Below: "), select));
    }
    const length = make("div", { className: "over bar" }), pointer = make("div", { className: "over north", textContent: `▲\n${word("N")}` });
    pointer.style.whiteSpace = "pre";
    pointer.setAttribute("role", "img");
    pointer.setAttribute("aria-label", word("North is up"));
    const place = () => { // the scale bar, and where the axes end
      const [x, y] = axes(), size = canvas._fullLayout._size;
      length.style.left = `${size.l + 10}px`;
      length.style.bottom = pointer.style.bottom = `${canvas.clientHeight - y._offset - y._length + 10}px`;
      pointer.style.right = `${size.r + 10}px`;
      const pixel = (x.range[1] - x.range[0]) / x._length, [unit, own] = data.length, long = round(pixel * 140 / own), bar = make("span");
      bar.style.width = `${long * own / pixel}px`;
      length.replaceChildren(decimals(unit !== "m" ? `${+long.toPrecision(3)} ${unit}` : long >= 1000 ? `${long / 1000} km` : long >= 1 ? `${long} m` : `${+(long * 100).toPrecision(3)} cm`), bar);
    };
    if (data.length) { whole.append(length); canvas.on("plotly_afterplot", place); place(); }
    if (data.north) whole.append(pointer);

    const last = traces.length - 1;
    const show = (layer, group, [row, parts], zoom) => {
      const marked = flat(data, parts), line = document.getElementById(`${layer.table}-${row}`);
      Plotly.restyle(canvas, { x: [marked.x], y: [marked.y] }, [last]);
      if (line) choose(line, asked);
      else {
        asked.replaceChildren(make("strong", { textContent: `${layer.name}, ${row + 1}` }));
        asked.hidden = false;
      }
      if (!zoom) return;
      const span = (values) => { const some = values.filter((v) => v !== null); return [Math.min(...some), Math.max(...some)]; };
      const [xs, ys] = [span(marked.x), span(marked.y)], half = Math.max((xs[1] - xs[0]) * 0.7, (ys[1] - ys[0]) * 0.7, (east - west) / 16);
      const [x, y] = [(xs[0] + xs[1]) / 2, (ys[0] + ys[1]) / 2];
      Plotly.relayout(canvas, { "xaxis.range": [x - half, x + half], "yaxis.range": [y - half, y + half] });
      figure.scrollIntoView({ block: "start" });
    };
    let down = null;
    whole.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; }, true);
    addEventListener("pointerup", (event) => { // of the window: plotly covers it while a button is down
      const from = down;
      down = null;
      if (!from || Math.hypot(event.clientX - from[0], event.clientY - from[1]) > 5) return;
      const [xa, ya] = axes(), box = canvas.getBoundingClientRect();
      const px = event.clientX - box.left - xa._offset, py = event.clientY - box.top - ya._offset;
      if (px < 0 || py < 0 || px > xa._length || py > ya._length) return;
      const x = xa.p2d(px) - data.x0, y = ya.p2d(py) - data.y0, reach = 9 * (xa.range[1] - xa.range[0]) / xa._length;
      let best = null;
      groups.forEach(([layer, group], trace) => {
        if (canvas.data[trace].visible === "legendonly") return;
        for (const feature of group.features) {
          const far = away(feature[1], x, y, group.shape === "point"), near = far <= reach;
          if (!near && !(group.shape === "area" && within(feature[1], x, y))) continue;
          const listed = document.getElementById(`${layer.table}-${feature[0]}`); // what has a row is asked for
          const rank = { point: 0, line: 1, area: 2 }[group.shape] * 1e9 + far + (listed ? 0 : 1e12); // points lie on top
          if (!best || rank < best.rank) best = { rank, layer, group, feature };
        }
      });
      if (best) show(best.layer, best.group, best.feature, false);
    }, true);
    document.addEventListener("click", (event) => {
      const link = event.target.closest("a.place");
      if (!link) return;
      const [, name, row] = link.getAttribute("href").match(/^#(.*)-(\d+)$/);
      for (const [layer, group] of groups) for (const feature of group.features)
        if (layer.table === name && feature[0] === +row) { event.preventDefault(); show(layer, group, feature, true); return; }
    });
  };

  // View in space ------------------------------------------------------------------------------
  const unpacked = ({ step, packed }) => {
    const steps = new Int16Array(bytes(packed).buffer), count = steps.length / 3;
    const [x, y, z] = [0, 1, 2].map((side) => Float32Array.from({ length: count }, (_, k) => steps[3 * k + side] * step));
    return { x, y, z };
  };
  const parted = (places, sizes) => { // with nothing between the parts, so that no line joins them
    const woven = { x: [], y: [], z: [] };
    for (const axis of ["x", "y", "z"]) {
      let from = 0;
      for (const size of sizes) {
        if (from) woven[axis].push(null);
        for (const place of places[axis].subarray(from, from += size)) woven[axis].push(place);
      }
    }
    return woven;
  };
  const drawSpace = async (figure, data) => {
    if (!make("canvas").getContext("webgl")) throw new Error("no WebGL");
    const Plotly = await plotly();
    const { canvas, asked, button, keys } = board(figure, word("View in space. Arrow keys turn it, plus and minus zoom, 0 shows all."));
    const traces = [], rows = [];
    for (const cloud of data.clouds) {
      const marker = { size: cloud.size, color: cloud.colour };
      if (cloud.codes) Object.assign(marker, { color: bytes(cloud.codes), colorscale: cloud.ramp.map((c, k) => [k / (cloud.ramp.length - 1), c]), cmin: 0, cmax: 255 });
      traces.push({ type: "scatter3d", mode: "markers", name: cloud.name, marker, hoverinfo: "none", ...unpacked(cloud.xyz) });
      rows.push(null);
    }
    for (const line of data.lines) {
      traces.push({ type: "scatter3d", mode: line.marks ? "markers" : "lines", name: line.name, line: { color: line.colour, width: 4 }, marker: { size: 7, color: line.colour, symbol: "diamond", line: { color: "#fff", width: 1 } }, hoverinfo: "none", ...parted(unpacked(line.xyz), line.sizes) });
      rows.push(line.table ? [line.table, line.sizes.flatMap((size, k) => [...Array(size).fill(line.rows[k]), null])] : null);
    }
    for (const mesh of data.meshes) {
      const { x, y, z } = unpacked(mesh.xyz), corner = (k) => Uint32Array.from({ length: x.length / 3 }, (_, place) => 3 * place + k);
      traces.push({ type: "mesh3d", name: mesh.name, color: mesh.colour, opacity: mesh.opacity, x, y, z, i: corner(0), j: corner(1), k: corner(2), hoverinfo: "none", showlegend: true, flatshading: true });
      rows.push(null);
    }
    const first = data.eye, axis = { title: { text: "" }, showbackground: false, showspikes: false, tickfont: { size: 10 }, nticks: 5 };
    const phone = innerWidth < 640;
    const layout = {
      font: FONT, separators: comma ? ",." : ".,", margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#f4f6f8", uirevision: 1,
      scene: { aspectmode: "data", dragmode: "turntable", camera: { eye: first, up: { x: 0, y: 0, z: 1 } }, xaxis: { ...axis, title: { text: data.axes[0] } }, yaxis: { ...axis, title: { text: data.axes[1] } }, zaxis: { ...axis, title: { text: data.axes[2] } } },
      legend: phone ? { itemsizing: "constant", orientation: "h", x: 0, y: -0.02, yanchor: "top", maxheight: 0.3 } : { itemsizing: "constant", x: 1.01, xanchor: "left", y: 1 },
    };
    await Plotly.newPlot(canvas, traces, layout, LOOK);
    figure.classList.add("drawn");
    const turn = (round, up, zoom = 1) => {
      const { eye, center } = canvas._fullLayout.scene._scene.getCamera();
      const far = Math.hypot(eye.x - center.x, eye.y - center.y, eye.z - center.z) * zoom;
      const heading = Math.atan2(eye.y - center.y, eye.x - center.x) + round;
      const height = Math.min(Math.max(Math.asin((eye.z - center.z) / far * zoom) + up, -1.5), 1.5);
      const flatFar = far * Math.cos(height);
      return Plotly.relayout(canvas, { "scene.camera.eye": { x: center.x + flatFar * Math.cos(heading), y: center.y + flatFar * Math.sin(heading), z: center.z + far * Math.sin(height) } });
    };
    const all = () => Plotly.relayout(canvas, { "scene.camera": { eye: first, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } } });
    button("+", word("Zoom in"), () => turn(0, 0, 0.7));
    button("−", word("Zoom out"), () => turn(0, 0, 1.4));
    button("◀", word("Turn left"), () => turn(-0.3, 0));
    button("▶", word("Turn right"), () => turn(0.3, 0));
    button("▲", word("From higher up"), () => turn(0, 0.2));
    button("▼", word("From lower down"), () => turn(0, -0.2));
    button(word("Show all"), word("Show all"), all);
    keys({ ArrowLeft: () => turn(-0.2, 0), ArrowRight: () => turn(0.2, 0), ArrowUp: () => turn(0, 0.15), ArrowDown: () => turn(0, -0.15), "+": () => turn(0, 0, 0.7), "-": () => turn(0, 0, 1.4), 0: all });
    canvas.on("plotly_click", ({ points: [point] }) => {
      const named = rows[point.curveNumber], row = named && document.getElementById(`${named[0]}-${named[1][point.pointNumber]}`);
      if (row) choose(row, asked);
      else {
        asked.replaceChildren(`${point.data.name}: ${["x", "y", "z"].map((side, k) => (data.origin[k] + point[side]).toFixed(2)).map(decimals).join(comma ? "; " : ", ")}`);
        asked.hidden = false;
      }
    });
  };

  // All plots of the page, each when it comes into view ------------------------------------------
  const draw = async (figure) => {
    const data = JSON.parse(figure.querySelector("script").textContent);
    try {
      await (figure.dataset.kind === "map" ? drawMap : drawSpace)(figure, data);
    } catch (error) { // an old browser, or one without WebGL: the picture stays
      figure.classList.remove("drawn");
      figure.querySelector(".board")?.remove();
      figure.querySelector(".tools")?.remove();
      figure.querySelector("figcaption").append(` (A picture: this browser cannot draw the plot: ${error.message}.)`);
    }
  };
  const figures = document.querySelectorAll("figure.plot"), placed = new Set();
  for (const figure of document.querySelectorAll("figure.plot[data-kind=map]"))
    for (const layer of JSON.parse(figure.querySelector("script").textContent).layers)
      for (const group of layer.groups) for (const [row] of group.features) placed.add(`#${layer.table}-${row}`);
  for (const link of document.querySelectorAll("a.place")) if (!placed.has(link.getAttribute("href"))) link.replaceWith(...link.childNodes);
  const near = new IntersectionObserver((seen) => {
    for (const { isIntersecting, target } of seen) if (isIntersecting) { near.unobserve(target); draw(target); }
  }, { rootMargin: "400px" });
  for (const figure of figures) figure.dataset.kind === "map" ? draw(figure) : near.observe(figure);
})();
