// The torques of the joints, what is left of them, their spectra, and where they come from. Figures near the window are
// drawn first, the others while the browser has nothing else to do, so that a printed page is complete.
(function () {
  "use strict";
  function element(id) { return document.getElementById(id); }
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var touch = window.matchMedia("(pointer: coarse)");
  var light = { text: "#4a4f55", grid: "#e6e6e2", zero: "#c9c9c4", measured: "#8b8b8b", unconstrained: "#e8963f", feasible: "#005f9e",
    residual: "#a33a6b", band: "rgba(90,96,103,0.28)",
    parts: ["#1d2023", "#005f9e", "#d17a1f", "#a33a6b", "#00785c", "#6a51a3", "#7a6a00", "#b03a2e", "#4a4f55"] };
  var night = { text: "#b4b9bf", grid: "#2c3136", zero: "#4a5057", measured: "#8f959b", unconstrained: "#b8651b", feasible: "#7cc4f5",
    residual: "#f08cb8", band: "rgba(180,185,191,0.30)",
    parts: ["#e4e6e8", "#7cc4f5", "#f0a85a", "#f08cb8", "#6fd3b5", "#b6a3e6", "#e6d27a", "#ff9a8c", "#b4b9bf"] };
  var printing = false, busy = false, span = null, buffers = {};

  function colors() { return dark.matches && !printing ? night : light; }
  function json(id) { var found = element(id); return found ? JSON.parse(found.textContent) : null; }
  var logs = json("torque-data"), sources = json("source-data");

  function inflated(id) {
    var bytes = Uint8Array.from(atob(element(id).textContent), function (c) { return c.charCodeAt(0); });
    var plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(plain).arrayBuffer().then(function (buffer) { buffers[id] = buffer; });
  }
  // A curve is differences of neighbours, of two bytes each; one number stands for what is missing.
  function curve(id, place) {
    var steps = new Int16Array(buffers[id].slice(place.at, place.at + 2 * place.n)), level = 0, values = new Array(place.n);
    for (var k = 0; k < place.n; k++) {
      level = (level + steps[k]) << 16 >> 16;
      values[k] = level === -32768 ? null : place.low + (level + 32500) * place.step;
    }
    return values;
  }

  function axis(title, more) {
    var c = colors();
    return Object.assign({ title: { text: title, standoff: 4 }, gridcolor: c.grid, zerolinecolor: c.zero, zerolinewidth: 1, ticks: "",
      automargin: true }, more);
  }
  function layout(height, more) {
    return Object.assign({ autosize: !printing, width: printing ? 640 : undefined, height: height, margin: { l: 52, r: 8, t: 6, b: 34 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { family: "system-ui, sans-serif", size: 11, color: colors().text },
      showlegend: false, hovermode: "x unified", hoverlabel: { font: { size: 11 } }, dragmode: touch.matches ? false : "zoom" }, more);
  }
  function line(x, y, color, width, more) {
    return Object.assign({ type: "scatter", mode: "lines", x: x, y: y, line: { color: color, width: width },
      hovertemplate: "%{y:.4g}" }, more);
  }
  function range(extent) { return span ? { range: span.slice(), autorange: false } : extent; }
  var plain = { displayModeBar: false, responsive: true };

  // Torques

  var choice = element("log-choice");
  var kinds = ["measured", "unconstrained", "feasible"];
  var names = { measured: "measured", unconstrained: "least squares", feasible: "answer" };
  var widths = { measured: 1, unconstrained: 4.5, feasible: 1.8 };
  function log() { return logs[Number(choice.value)]; }
  function visible(kind) { return document.querySelector('[data-curve="' + kind + '"]').checked; }

  function drawTorque(plot) {
    var index = Number(plot.id.split("-")[1]), joint = log().joints[index], c = colors(), id = "torque-curves";
    var t = curve(id, joint.t), left = curve(id, joint.residual);
    var most = Math.max.apply(null, left.map(function (v) { return Math.abs(v || 0); }).concat([2.4 * (joint.noise || 0)])) * 1.06 || 1;
    var traces = kinds.map(function (kind) {
      return line(t, curve(id, joint[kind]), c[kind], widths[kind], { name: names[kind], visible: visible(kind) });
    });
    traces.push(line(t, left, c.residual, 1, { name: "residual", yaxis: "y2" }));
    var band = joint.noise === null ? [] : [{ type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y2", y0: -2 * joint.noise, y1: 2 * joint.noise,
      fillcolor: c.band, line: { width: 1, color: c.text }, layer: "above" }];
    plot.setAttribute("aria-label", joint.label);
    element(plot.id + "-error").textContent = joint.error;
    return Plotly.react(plot, traces, layout(280, {
      shapes: band,
      xaxis: axis("time, s", Object.assign({ anchor: "y2" }, range({ autorange: true }))),
      yaxis: axis(joint.unit, { domain: [0.42, 1], fixedrange: true, nticks: 6 }),
      yaxis2: axis("residual", { domain: [0, 0.32], fixedrange: true, nticks: 4, range: [-most, most] })
    }), plain).then(function () {
      if (!plot.dataset.linked) { plot.dataset.linked = "yes"; plot.on("plotly_relayout", follow); }
    });
  }

  // One span of time for all the joints, those not drawn yet included.
  function follow(event) {
    if (busy) { return; }
    if (event["xaxis.autorange"]) { zoom(null); }
    else if (event["xaxis.range[0]"] !== undefined) { zoom([event["xaxis.range[0]"], event["xaxis.range[1]"]]); }
  }
  function zoom(to) {
    span = to;
    busy = true;
    var change = to ? { "xaxis.range": to, "xaxis.autorange": false } : { "xaxis.autorange": true };
    var drawn = tasks.filter(function (task) { return task.draw === drawTorque && task.done; });
    document.documentElement.dataset.span = to ? to.map(function (v) { return v.toFixed(3); }).join(" ") : "";
    Promise.all(drawn.map(function (task) { return Plotly.relayout(task.plot, Object.assign({}, change)); }))
      .then(function () { busy = false; }, function () { busy = false; });
  }
  function step(kind) {
    var ends = log().joints[0].t, last = ends.low + 65000 * ends.step, now = span || [0, last], width = now[1] - now[0], middle = (now[0] + now[1]) / 2;
    if (kind === "whole") { zoom(null); return; }
    if (kind === "in" || kind === "out") {
      width *= kind === "in" ? 0.5 : 2;
      now = [middle - width / 2, middle + width / 2];
    } else {
      var shift = (kind === "later" ? 0.5 : -0.5) * width;
      now = [now[0] + shift, now[1] + shift];
    }
    if (now[0] < 0) { now = [0, now[1] - now[0]]; }
    if (now[1] > last) { now = [Math.max(0, last - (now[1] - now[0])), last]; }
    zoom(now[0] <= 0 && now[1] >= last ? null : now);
  }

  // Spectrum and autocorrelation, when they are asked for

  function drawPattern(details) {
    if (!details.open) { return Promise.resolve(); }
    var index = Number(details.dataset.joint), joint = log().joints[index], c = colors(), id = "torque-curves";
    var spectrum = element("spectrum-" + index), lags = element("lags-" + index);
    if (!joint.frequency) {
      spectrum.textContent = "The stretches of this log are too short, or its rate is not known.";
      return Promise.resolve();
    }
    function power(place) { return curve(id, place).map(function (v) { return v === null ? null : Math.pow(10, v); }); }
    var frequency = power(joint.frequency), density = power(joint.density);
    var floor = joint.noise === null ? null : joint.noise / Math.sqrt(joint.nyquist), bound = joint.bound;
    var ends = [frequency[0], frequency[frequency.length - 1]];
    var traces = [line(frequency, density, c.residual, 1.4, { name: "residual" })];
    if (floor) { traces.push(line(ends, [floor, floor], c.measured, 1.4, { name: "white noise", line: { color: c.measured, width: 1.4, dash: "dash" } })); }
    spectrum.setAttribute("aria-label", "Spectrum of the residual: " + joint.unit + " per root of Hz over frequency");
    lags.setAttribute("aria-label", "Autocorrelation of the residual over the lag in seconds");
    var lag = curve(id, joint.lag);
    return Plotly.react(spectrum, traces, layout(200, { xaxis: axis("frequency, Hz", { type: "log" }),
      yaxis: axis(joint.unit + "/\u221aHz", { type: "log", exponentformat: "power" }) }), plain).then(function () {
      return Plotly.react(lags, [line(lag, curve(id, joint.correlation), c.residual, 1.4, { name: "autocorrelation" })], layout(200, {
        shapes: [{ type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y", y0: -bound, y1: bound, fillcolor: c.band, line: { width: 0 }, layer: "below" }],
        xaxis: axis("lag, s", {}), yaxis: axis("autocorrelation", { range: [-1.05, 1.05] }) }), plain);
    }).then(function () { details.dataset.drawn = "yes"; });
  }

  // Sources

  function drawSource(plot) {
    var joint = sources.joints[Number(plot.id.split("-")[1])], c = colors(), id = "source-curves", t = curve(id, joint.t);
    function shown(place) { return document.querySelector('[data-source="' + place + '"]').checked; }
    var traces = [line(t, curve(id, joint.total), c.parts[0], 3, { name: "all together", opacity: 0.45, visible: shown(0) })];
    joint.parts.forEach(function (part, place) {
      traces.push(line(t, curve(id, part), c.parts[(place + 1) % c.parts.length], 1.4, { name: sources.names[place], visible: shown(place + 1) }));
    });
    plot.setAttribute("aria-label", joint.label);
    return Plotly.react(plot, traces, layout(220, { xaxis: axis("time, s", {}), yaxis: axis(joint.unit, { fixedrange: true, nticks: 6 }) }), plain);
  }

  // What is to be drawn, and when

  var tasks = [];
  function collect(selector, draw) {
    document.querySelectorAll(selector).forEach(function (plot) { tasks.push({ plot: plot, draw: draw, done: false, near: false }); });
  }
  if (logs) { collect(".plot[id^=torque-]", drawTorque); }
  if (sources) { collect(".plot[id^=source-]", drawSource); }
  function run(task) { task.done = true; return task.draw(task.plot); }
  function again(draw) {
    var wanted = tasks.filter(function (task) { return task.done && (!draw || task.draw === draw); });
    var open = draw === drawSource ? [] : Array.from(document.querySelectorAll("details.pattern"));
    return Promise.all(wanted.map(run).concat(open.map(drawPattern)));
  }
  function next() {
    var waiting = tasks.filter(function (task) { return !task.done; });
    if (!waiting.length) { document.documentElement.dataset.torques = "drawn"; return; }
    var task = waiting.find(function (one) { return one.near; }) || waiting[0];
    run(task).then(function () { (window.requestIdleCallback || setTimeout)(next); });
  }
  function said() { if (logs) { element("torque-rows").textContent = log().rows; } }

  Promise.all(["torque-curves", "source-curves"].filter(element).map(inflated)).then(function () {
    var watcher = new IntersectionObserver(function (entries) {
      entries.forEach(function (entry) {
        var task = tasks.find(function (one) { return one.plot === entry.target; });
        task.near = entry.isIntersecting;
        if (task.near && !task.done) { run(task); }
      });
    }, { rootMargin: "300px" });
    tasks.forEach(function (task) { watcher.observe(task.plot); });
    said();
    next();
    if (choice) { choice.addEventListener("change", function () { span = null; said(); again(drawTorque); }); }
    document.querySelectorAll("[data-curve]").forEach(function (box) { box.addEventListener("change", function () { again(drawTorque); }); });
    document.querySelectorAll("[data-source]").forEach(function (box) { box.addEventListener("change", function () { again(drawSource); }); });
    document.querySelectorAll("[data-zoom]").forEach(function (button) { button.addEventListener("click", function () { step(button.dataset.zoom); }); });
    document.querySelectorAll("details.pattern").forEach(function (details) { details.addEventListener("toggle", function () { drawPattern(details); }); });
    dark.addEventListener("change", function () { again(); });
    window.addEventListener("beforeprint", function () { printing = true; again(); });
    window.addEventListener("afterprint", function () { printing = false; again(); });
  });
})();
