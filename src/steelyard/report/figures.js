(function () {
  "use strict";
  var logs = JSON.parse(document.getElementById("torque-data").textContent);
  var choice = document.getElementById("log-choice");
  var boxes = Array.from(document.querySelectorAll(".legend input"));
  var plots = Array.from(document.querySelectorAll(".plot"));
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var touch = window.matchMedia("(pointer: coarse)");
  var kinds = ["measured", "unconstrained", "feasible"];
  var names = { measured: "measured", unconstrained: "least squares", feasible: "feasible" };
  var widths = { measured: 1, unconstrained: 4.5, feasible: 1.8 };
  var light = { text: "#4a4f55", grid: "#e6e6e2", zero: "#c9c9c4", measured: "#8b8b8b", unconstrained: "#e8963f", feasible: "#005f9e" };
  var night = { text: "#b4b9bf", grid: "#2c3136", zero: "#4a5057", measured: "#8f959b", unconstrained: "#b8651b", feasible: "#7cc4f5" };
  var busy = false;

  function layout(joint, colors, width) {
    var axis = { gridcolor: colors.grid, zerolinecolor: colors.zero, zerolinewidth: 1, ticks: "", automargin: true };
    return {
      autosize: width === undefined, width: width, height: 190,
      margin: { l: 46, r: 8, t: 6, b: 34 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 11, color: colors.text },
      showlegend: false, hovermode: "x unified",
      hoverlabel: { font: { size: 11 } },
      dragmode: touch.matches ? false : "zoom",
      xaxis: Object.assign({ title: { text: "time, s", standoff: 4 } }, axis),
      yaxis: Object.assign({ title: { text: joint.unit, standoff: 4 }, fixedrange: true, nticks: 6 }, axis)
    };
  }

  function draw(colors, width) {
    var log = logs[Number(choice.value)];
    return Promise.all(plots.map(function (plot, index) {
      var joint = log.joints[index];
      var traces = kinds.map(function (kind, number) {
        return {
          type: "scatter", mode: "lines", x: log.t, y: joint[kind], name: names[kind],
          visible: boxes[number].checked, hovertemplate: "%{y:.4g}",
          line: { color: colors[kind], width: widths[kind] }
        };
      });
      plot.setAttribute("aria-label", joint.label);
      document.getElementById(plot.id + "-error").textContent = joint.error;
      return Plotly.react(plot, traces, layout(joint, colors, width), { displayModeBar: false, responsive: true });
    }));
  }

  function redraw() { return draw(dark.matches ? night : light); }

  // One span of time for all the joints.
  function follow(event) {
    if (busy) { return; }
    var change = null;
    if (event["xaxis.autorange"]) {
      change = { "xaxis.autorange": true };
    } else if (event["xaxis.range[0]"] !== undefined) {
      change = { "xaxis.range": [event["xaxis.range[0]"], event["xaxis.range[1]"]] };
    }
    if (change === null) { return; }
    busy = true;
    Promise.all(plots.map(function (plot) { return Plotly.relayout(plot, Object.assign({}, change)); }))
      .then(function () { busy = false; }, function () { busy = false; });
  }

  redraw().then(function () {
    plots.forEach(function (plot) { plot.on("plotly_relayout", follow); });
    choice.addEventListener("change", redraw);
    boxes.forEach(function (box) { box.addEventListener("change", redraw); });
    dark.addEventListener("change", redraw);
    window.addEventListener("beforeprint", function () { draw(light, 640); });
    window.addEventListener("afterprint", redraw);
    document.documentElement.dataset.figures = "drawn";
  });
})();
