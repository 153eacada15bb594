"use strict";
// Charts of one motion, joint and side; copies of tables and texts; the theme.
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
  const hidden = Object.fromEntries(["torque", "residual", "spectrum", "over-velocity", "over-position", "over-temperature"].map((name) => [name, new Set()]));
  let zoom = null;
  let zooming = false;

  // uPlot's own ticks have three decimals: torques of small motors were all 0.003 N m.
  const ticks = (_, splits) => splits.map((tick) => String(+tick.toPrecision(6)).replaceAll("-", "−"));
  const axis = (label, more) => ({
    stroke: colour("soft"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1 },
    label, labelSize: 22, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", values: ticks, ...more,
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
    charts[name].over.addEventListener("dblclick", () => { if (name === "torque" || name === "residual") zoomTo(null); });
  };

  const reversals = (time, velocity) => {  // the sign changes between two speeds above 1 % of the largest
    const least = 0.01 * Math.max(...velocity.map(Math.abs));
    const found = [];
    let last = 0;
    velocity.forEach((speed, place) => {
      if (Math.abs(speed) < least) return;
      if (last && Math.sign(speed) !== last) found.push(time[place]);
      last = Math.sign(speed);
    });
    return found;
  };

  const markReversals = (times) => (chart) => {
    const { left, top, width, height } = chart.bbox;
    chart.ctx.save();
    chart.ctx.beginPath();
    chart.ctx.rect(left, top, width, height);
    chart.ctx.clip();
    chart.ctx.strokeStyle = colour("soft");
    chart.ctx.globalAlpha = 0.6;
    chart.ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    chart.ctx.lineWidth = devicePixelRatio;
    chart.ctx.beginPath();
    for (const one of times) {
      const x = Math.round(chart.valToPos(one, "x", true));
      chart.ctx.moveTo(x, top);
      chart.ctx.lineTo(x, top + height);
    }
    chart.ctx.stroke();
    chart.ctx.restore();
  };

  const overTime = (name, height, label, series, data, turns) => draw(name, {
    height, series: [{ label: "t [s]", value: (_, value) => (value == null ? "–" : value.toFixed(3)) }, ...series],
    scales: { x: { time: false } },
    axes: [name === "residual" ? axis("time [s]") : axis(undefined, { size: 34 }), axis(label, { size: 80 })],
    cursor: { y: false, sync: { key: "time" }, drag: { x: true, y: false, setScale: false } },
    hooks: { drawClear: [markReversals(turns)], setSelect: [(chart) => {
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
    height: 250, series: [{ label: "f [Hz]", value: (_, value) => digits(value) },
      line("measured", "measured", 4), line("computed", "computed", 1.2), line("residual", "residual", 1.2)],
    scales: { x: { time: false, distr: 3 }, y: { distr: 3 } },
    cursor: { y: false },
    axes: [axis("frequency [Hz]", { values: powers }), axis(`amplitude [${unit}]`, { size: 80, values: powers })],
    hooks: { drawClear: [shadeBand(cutoff)] },
  }, data);

  const scatter = (name, label, unit, x, y) => {  // points in the order of x, and the means of 24 bins
    const order = x.map((_, place) => place).filter((place) => y[place] != null).sort((a, b) => x[a] - x[b]);
    const [low, high] = [x[order[0]], x[order[order.length - 1]]];
    const bins = Array.from({ length: 24 }, () => []);
    for (const place of order) bins[Math.min(23, Math.floor(24 * (x[place] - low) / (high - low || 1)))].push(place);
    const means = new Map(bins.filter((one) => one.length > 4).map((one) => [one[one.length >> 1], one.reduce((sum, place) => sum + y[place], 0) / one.length]));
    const points = { show: true, size: 3, width: 0, stroke: colour("sample"), fill: colour("sample") };
    draw(name, {
      height: 250, series: [{ label, value: (_, value) => digits(value) },
        { label: "residual", stroke: colour("sample"), paths: () => null, points, value: (_, value) => digits(value) },
        { ...line("mean", "residual", 2), spanGaps: true }],
      scales: { x: { time: false } }, cursor: { y: false },
      axes: [axis(label), axis(`residual [${unit}]`, { size: 80 })],
    }, [order.map((place) => x[place]), order.map((place) => y[place]), order.map((place) => means.get(place) ?? null)]);
  };

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
    const motion = run.velocity && { velocity: unpacked(run.velocity[joint]), position: unpacked(run.position[joint]) };
    const turns = motion ? reversals(time, motion.velocity) : [];
    const residual = unpacked(trace.residual);
    overTime("torque", 300, `torque [${unit}]`,
      [line("measured", "measured", 5), line("computed", "computed", 1.4)], [time, measured, unpacked(trace.computed)], turns);
    overTime("residual", 190, `residual [${unit}]`, [line("measured − computed", "residual", 1.2)], [time, residual], turns);
    if (kept) zoomTo(kept);
    const spectra = ["measured", "computed", "residual"].map((one) => unpacked(trace.spectra[one]).map((power) => 10 ** power));
    overFrequency(unit, run.cutoff, [run.frequencies, ...spectra]);
    for (const figure of document.querySelectorAll(".scatter")) figure.hidden = !motion;
    if (motion) {
      const length = traces.units.load[joint] === "N" ? "m" : "rad";
      scatter("over-velocity", `velocity [${length}/s]`, unit, motion.velocity, residual);
      scatter("over-position", `position [${length}]`, unit, motion.position, residual);
      const warmth = run.temperature && run.temperature[joint];
      at("over-temperature").parentElement.hidden = !warmth;
      if (warmth) scatter("over-temperature", "temperature of the motor [°C]", unit, unpacked(warmth), residual.map((one, place) => one == null ? null : one * Math.sign(motion.velocity[place])));
    }
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

  const save = (name, content, type) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };

  const stripped = (text) => text.replace(/^\s+|\s+$/g, "");
  const cellsOf = (row) => [...row.cells].map((cell) => {
    const exact = cell.querySelector("data");
    const more = cell.querySelector("details");
    const text = more ? more.lastChild.textContent : cell.textContent;
    return { text: stripped(text), exact: exact ? exact.value : null };
  });
  const csv = (rows) => rows.map((row) => row.map(({ text, exact }) => {
    const plain = exact ?? text.replaceAll("−", "-").replace(/·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, raised) => `e${lowered(raised)}`);
    return /[",\n;]/.test(plain) ? `"${plain.replaceAll('"', '""')}"` : plain;
  }).join(",")).join("\r\n") + "\r\n";
  const lowered = (raised) => [...raised].map((one) => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(one)]).join("");
  const SIGNS = { "\\": "\\textbackslash{}", "{": "\\{", "}": "\\}", "_": "\\_", "&": "\\&", "%": "\\%", "#": "\\#", "$": "\\$", "^": "\\textasciicircum{}", "~": "\\textasciitilde{}",
    "−": "$-$", "±": "$\\pm$", "×": "$\\times$", "…": "\\dots{}", "²": "$^2$", "³": "$^3$", "⁵": "$^5$", "–": "--", "<": "$<$", ">": "$>$", "\u00a0": "~" };
  const tex = (text) => text.split(/(·?10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/).map((part, place) => (place % 2
    ? `$${part[0] === "·" ? "\\cdot " : ""}10^{${lowered(part.replace(/^·?10/, ""))}}$` : part.replace(/[\\{}_&%#$^~−±×…²³⁵–<>\u00a0]/g, (one) => SIGNS[one]))).join("");
  const latex = ([head, ...rows], table) => {
    const sides = [...table.tHead.rows[0].cells].map((cell, place) => (place === 0 || cell.className === "text" ? "l" : "r")).join("");
    const line = (row) => `  ${row.map(({ text }) => tex(text)).join(" & ")} \\\\`;
    return [`% ${stripped(table.caption.textContent)}`, `\\begin{tabular}{${sides}}`, "  \\toprule", line(head), "  \\midrule", ...rows.map(line), "  \\bottomrule", "\\end{tabular}", ""].join("\n");
  };

  const startCopies = () => {
    for (const place of document.querySelectorAll(".table")) {
      const table = place.querySelector("table");
      const name = `${stripped(document.querySelector("h1").textContent)} ${place.dataset.name}`.replace(/[^\w-]+/g, "_");
      place.querySelector(".copies").hidden = false;
      place.querySelector(".copies").addEventListener("click", ({ target }) => {
        const rows = [...table.rows].map(cellsOf);
        if (target.dataset.copy === "csv") save(`${name}.csv`, "\ufeff" + csv(rows), "text/csv");
        if (target.dataset.copy === "latex") save(`${name}.tex`, latex(rows, table), "text/x-tex");
      });
    }
    for (const button of document.querySelectorAll(".code .copy")) {
      const code = button.parentElement.querySelector("code");
      button.hidden = false;
      button.addEventListener("click", async () => {
        try {
          await navigator.clipboard.writeText(code.textContent);
          button.textContent = "Copied";
        } catch {  // a page from a file may have no clipboard
          getSelection().selectAllChildren(code);
          button.textContent = document.execCommand("copy") ? "Copied" : "Selected";
        }
      });
    }
  };

  let opened = [];
  addEventListener("beforeprint", () => { opened = [...document.querySelectorAll("details:not([open])")]; opened.forEach((one) => { one.open = true; }); });
  addEventListener("afterprint", () => { opened.forEach((one) => { one.open = false; }); });

  // A link to a notice opens its cause and advice, and what it is folded in.
  const showLinked = () => {
    const linked = at(location.hash.slice(1));
    if (!linked?.matches(".notice")) return;
    linked.querySelectorAll("details").forEach((one) => { one.open = true; });
    for (let part = linked.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
    linked.scrollIntoView();
  };
  addEventListener("hashchange", showLinked);

  showLinked();
  if (traces) startTraces();
  startCopies();
  startTheme();
})();
