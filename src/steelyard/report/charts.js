(function () {
  "use strict";
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var touch = window.matchMedia("(pointer: coarse)");
  var light = { text: "#4a4f55", grid: "#e6e6e2", zero: "#c9c9c4",
    curves: ["#005f9e", "#d17a1f", "#00785c", "#a33a6b", "#6a51a3", "#7a6a00", "#b03a2e", "#4a4f55"] };
  var night = { text: "#b4b9bf", grid: "#2c3136", zero: "#4a5057",
    curves: ["#7cc4f5", "#f0a85a", "#6fd3b5", "#f08cb8", "#b6a3e6", "#e6d27a", "#ff9a8c", "#b4b9bf"] };
  var charts = [];
  Array.from(document.querySelectorAll("script.chart-data")).forEach(function (script) {
    JSON.parse(script.textContent).forEach(function (data, index) {
      charts.push({ plot: document.getElementById(script.dataset.for + "-" + index), data: data });
    });
  });

  function axis(title, log, colors) {
    return { title: { text: title, standoff: 6 }, type: log ? "log" : "linear", gridcolor: colors.grid,
      zerolinecolor: colors.zero, zerolinewidth: 1, ticks: "", automargin: true,
      exponentformat: "power", nticks: log ? undefined : 7 };
  }

  function draw(colors, width) {
    return Promise.all(charts.map(function (chart) {
      var traces = chart.data.curves.map(function (curve) {
        var color = colors.curves[curve.color % colors.curves.length];
        return { type: "scatter", mode: curve.style === "points" ? "markers" : "lines", name: curve.name,
          x: curve.x, y: curve.y, hovertemplate: "%{y:.5g}", marker: { color: color, size: 6 },
          line: { color: color, width: 1.7, dash: curve.style === "dashed" ? "dash" : "solid" } };
      });
      return Plotly.react(chart.plot, traces, {
        autosize: width === undefined, width: width, height: 320,
        margin: { l: 56, r: 10, t: 8, b: 40 },
        paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: "system-ui, sans-serif", size: 12, color: colors.text },
        showlegend: traces.length > 1, legend: { orientation: "h", y: -0.22, yanchor: "top" },
        hovermode: "x unified", hoverlabel: { font: { size: 11 } }, dragmode: touch.matches ? false : "zoom",
        xaxis: axis(chart.data.x, chart.data.xLog, colors), yaxis: axis(chart.data.y, chart.data.yLog, colors)
      }, { displayModeBar: false, responsive: true });
    }));
  }

  function redraw() { return draw(dark.matches ? night : light); }

  redraw().then(function () {
    dark.addEventListener("change", redraw);
    window.addEventListener("beforeprint", function () { draw(light, 640); });
    window.addEventListener("afterprint", redraw);
    document.documentElement.dataset.figures = "drawn";
  });
})();
