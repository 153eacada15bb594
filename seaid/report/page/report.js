"use strict";
// Charts of the page: traces and spectrum of one motion, joint and side; the map's values; the theme.
(() => {
  const at = (id) => document.getElementById(id);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).replaceAll(" ", "");
  const stored = (id) => { const tag = at(id); return tag ? JSON.parse(tag.textContent) : null; };
  const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer;
  const MISSING = -32768;
  const unpacked = (trace) => {
    const view = new DataView(bytes(trace.data));
    return Array.from({ length: view.byteLength / 2 }, (_, place) => {
      const step = view.getInt16(2 * place, true);
      return step === MISSING ? null : trace.offset + trace.scale * step;
    });
  };
  const digits = (value) => (value == null ? "–" : Math.abs(value) < 1e-3 && value !== 0 ? value.toExponential(2) : value.toPrecision(4));

  const traces = stored("traces-data");
  const charts = {};
  const hidden = { torque: new Set(), residual: new Set(), spectrum: new Set() };
  let zoom = null;
  let zooming = false;

  const axis = (label, more) => ({
    stroke: colour("soft"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1 },
    label, labelSize: 22, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", ...more,
  });
  const powers = (_, splits) => splits.map((one) => {
    if (one == null || Math.abs(Math.log10(one) - Math.round(Math.log10(one))) > 1e-6) return "";
    return one >= 1e-3 && one < 1e4 ? String(+one.toPrecision(1)) : one.toExponential(0).replace("-", "−");
  });
  const line = (label, name, width) => ({
    label, stroke: colour(name), width, pxAlign: 0, points: { show: false }, value: (_, value) => digits(value),
  });

  const zoomTo = (range) => {  // both time charts show the same interval
    zoom = range;
    if (zooming) return;
    zooming = true;
    for (const chart of [charts.torque, charts.residual]) {
      const time = chart.data[0];
      chart.setScale("x", range || { min: time[0], max: time[time.length - 1] });
    }
    zooming = false;
  };

  const draw = (name, options, data) => {
    const place = at(name);
    if (charts[name]) charts[name].destroy();
    place.textContent = "";
    const series = options.series.map((one) => ({ ...one, show: !hidden[name].has(one.label) }));
    const hooks = { ...options.hooks, setSeries: [(chart, index) => {
      if (index == null) return;
      const one = chart.series[index];
      hidden[name][one.show ? "delete" : "add"](one.label);
    }] };
    charts[name] = new uPlot({ width: Math.max(place.clientWidth, 260), ...options, series, hooks }, data, place);
    charts[name].over.addEventListener("dblclick", () => { if (name !== "spectrum") zoomTo(null); });
  };

  const overTime = (name, height, label, series, data) => draw(name, {
    height, series: [{ label: "t [s]", value: (_, value) => (value == null ? "–" : value.toFixed(3)) }, ...series],
    scales: { x: { time: false } },
    axes: [name === "residual" ? axis("time [s]") : axis(undefined, { size: 34 }), axis(label, { size: 66 })],
    cursor: { y: false, sync: { key: "time" }, drag: { x: true, y: false, setScale: false } },
    hooks: { setSelect: [(chart) => {
      if (chart.select.width < 4) return;
      const min = chart.posToVal(chart.select.left, "x");
      const max = chart.posToVal(chart.select.left + chart.select.width, "x");
      chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      zoomTo({ min, max });
    }] },
  }, data);

  const shadeBand = (cutoff) => (chart) => {
    const { left, top, width, height } = chart.bbox;
    const right = Math.min(Math.max(chart.valToPos(cutoff, "x", true), left), left + width);
    chart.ctx.save();
    chart.ctx.fillStyle = colour("band");
    chart.ctx.fillRect(left, top, right - left, height);
    chart.ctx.fillStyle = colour("soft");
    chart.ctx.fillRect(right, top, 1, height);
    chart.ctx.restore();
  };

  const overFrequency = (unit, cutoff, data) => draw("spectrum", {
    height: 300, series: [{ label: "f [Hz]", value: (_, value) => digits(value) },
      line("measured", "measured", 2.4), line("computed", "computed", 1.2), line("residual", "residual", 1.2)],
    scales: { x: { time: false, distr: 3 }, y: { distr: 3 } },
    cursor: { y: false },
    axes: [axis("frequency [Hz]", { values: powers }), axis(`amplitude [${unit}]`, { size: 66, values: powers })],
    hooks: { drawClear: [shadeBand(cutoff)] },
  }, data);

  const shown = () => {
    const run = traces.runs[+at("run").value];
    const joint = +at("joint").value;
    const side = at("side").value;
    return { run, joint, side, trace: run[side][joint], unit: traces.units[side][joint] };
  };

  const show = () => {
    const { run, joint, side, trace, unit } = shown();
    const kept = zoom;
    zoom = null;
    const measured = unpacked(trace.measured);
    const time = measured.map((_, place) => run.start + run.step * place);
    overTime("torque", 300, `torque [${unit}]`,
      [line("measured", "measured", 2.4), line("computed", "computed", 1.2)], [time, measured, unpacked(trace.computed)]);
    overTime("residual", 190, `residual [${unit}]`, [line("measured − computed", "residual", 1.2)], [time, unpacked(trace.residual)]);
    if (kept) zoomTo(kept);
    const spectra = ["measured", "computed", "residual"].map((one) => unpacked(trace.spectra[one]).map((power) => 10 ** power));
    overFrequency(unit, run.cutoff, [run.frequencies, ...spectra]);
    const seen = run.unseen ? "unseen" : "used for identification";
    at("shown").textContent = `${traces.joints[joint]}, ${side} side, ${run.name} (${seen}); below ${run.cutoff.toPrecision(3)} Hz.`;
    at("source").textContent = `Measured is ${traces.sources[side][joint]}.`;
    at("thinned").textContent = run.thinned;
  };

  const offer = () => {  // only what the selected motion has: joints, then sides of the joint
    const run = traces.runs[+at("run").value];
    const has = (side, joint) => run[side][joint] !== null;
    for (const option of at("joint").options) option.disabled = !has("actuator", +option.value) && !has("load", +option.value);
    if (at("joint").selectedOptions[0].disabled) at("joint").value = [...at("joint").options].find((one) => !one.disabled).value;
    const joint = +at("joint").value;
    for (const option of at("side").options) option.disabled = !has(option.value, joint);
    if (at("side").selectedOptions[0].disabled) at("side").value = [...at("side").options].find((one) => !one.disabled).value;
    show();
  };

  const fill = (select, names) => names.forEach((name, place) => select.add(new Option(name, place)));

  const startTraces = () => {
    const there = traces.runs.map((run) => [...run.actuator, ...run.load].some((one) => one !== null));
    if (!there.includes(true)) {
      at("scriptless").textContent = "No motion has a torque to show.";
      return;
    }
    fill(at("run"), traces.runs.map((run) => `${run.name}${run.unseen ? " (unseen)" : ""}`));
    fill(at("joint"), traces.joints);
    const first = traces.runs.findIndex((run, place) => run.unseen && there[place]);
    there.forEach((one, place) => { at("run").options[place].disabled = !one; });
    at("run").value = first >= 0 ? first : there.indexOf(true);
    at("run").addEventListener("change", () => { zoom = null; offer(); });
    for (const id of ["joint", "side"]) at(id).addEventListener("change", offer);
    at("reset").addEventListener("click", () => zoomTo(null));
    at("viewer").hidden = false;
    at("scriptless").hidden = true;
    offer();
    new ResizeObserver(() => {
      for (const [name, chart] of Object.entries(charts)) {
        const width = at(name).clientWidth;
        if (width > 0 && width !== chart.width) chart.setSize({ width, height: chart.height });
      }
    }).observe(at("viewer"));
  };

  const startMap = () => {
    const map = at("map");
    if (!map) return;
    const { names, data } = stored("correlations-data");
    const values = new Int8Array(bytes(data));
    const cell = +map.dataset.cell;
    const read = (event) => {
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(map.getScreenCTM().inverse());
      const column = Math.floor(point.x / cell);
      const row = Math.floor(point.y / cell);
      if (column < 0 || row < 0 || column >= names.length || row >= names.length) return;
      const value = values[row * names.length + column];
      at("picked").setAttribute("d", `M${column * cell} ${row * cell}h${cell}v${cell}h${-cell}z`);
      at("correlation").textContent = row === column ? names[row]
        : `${names[row]} and ${names[column]}: ${value === -128 ? "separate estimates" : (value / 100).toFixed(2).replace("-", "−")}`;
    };
    map.addEventListener("pointermove", read);
    map.addEventListener("pointerdown", read);
    at("correlation").textContent = "Point at a cell, or tap it, for names and value.";
  };

  const startTheme = () => {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    const root = document.documentElement;
    const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
    const settle = () => {
      at("theme").textContent = isDark() ? "Light" : "Dark";
      if (charts.torque) show();
    };
    at("theme").hidden = false;
    at("theme").addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; settle(); });
    dark.addEventListener("change", settle);
    settle();
  };

  let opened = [];
  addEventListener("beforeprint", () => { opened = [...document.querySelectorAll("details:not([open])")]; opened.forEach((one) => { one.open = true; }); });
  addEventListener("afterprint", () => { opened.forEach((one) => { one.open = false; }); });

  if (traces) startTraces();
  startMap();
  startTheme();
})();
