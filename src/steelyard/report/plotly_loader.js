(function () {
  "use strict";
  // Plotly is in the page as compressed text, a third of its size; the scripts that use it wait for it.
  function run(code) {
    var script = document.createElement("script");
    script.textContent = code;
    document.body.appendChild(script);
  }
  function text(id) { return document.getElementById(id).textContent; }
  if (!window.DecompressionStream) {
    var note = document.createElement("p");
    note.textContent = "This browser is too old to draw the figures; the tables hold their numbers.";
    document.querySelector("main").prepend(note);
    return;
  }
  function start() {
    var bytes = Uint8Array.from(atob(text("plotly")), function (c) { return c.charCodeAt(0); });
    var plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    new Response(plain).text().then(function (code) {
      run(code);
      Array.from(document.querySelectorAll("script.uses-plotly")).forEach(function (script) { run(script.textContent); });
    });
  }
  // The text is read before the figures: they wait until it is painted.
  function later() { (window.requestIdleCallback || setTimeout)(start, { timeout: 500 }); }
  if (document.readyState === "complete") { later(); } else { window.addEventListener("load", later); }
})();
