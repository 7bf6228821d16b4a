(function () {
  "use strict";
  // Turns the pictures that drawing.py has drawn: the same projection of the places that their elements carry.
  function numbers(text) { return text.split(" ").map(Number); }
  function dot(a, p, k) { return a[0] * p[k] + a[1] * p[k + 1] + a[2] * p[k + 2]; }

  function turnable(figure) {
    var svg = figure.querySelector("svg.robot-drawing");
    var ground = figure.querySelector(".ground-of-drawing");
    var box = svg.viewBox.baseVal, given = numbers(svg.dataset.view);
    var center = given.slice(0, 3), view = null, asked = false;
    var parts = ["line", "point", "disc", "ball", "label", "depth"].map(function (kind) {
      return Array.from(svg.querySelectorAll("[data-" + kind + "]")).map(function (element) {
        return { element: element, at: numbers(element.dataset[kind]) };
      });
    });

    function draw() {
      asked = false;
      var ca = Math.cos(view.azimuth), sa = Math.sin(view.azimuth), ce = Math.cos(view.elevation), se = Math.sin(view.elevation);
      var right = [-sa, ca, 0], down = [se * ca, se * sa, -ce], towards = [ce * ca, ce * sa, se];
      var scale = given[3] * view.zoom;
      var x0 = box.width / 2 - scale * dot(right, center, 0), y0 = box.height / 2 - scale * dot(down, center, 0);
      function x(p, k) { return scale * dot(right, p, k); }
      function y(p, k) { return scale * dot(down, p, k); }
      function matrix(one, a, b, c, d) {
        one.element.setAttribute("transform", "matrix(" + [a, b, c, d, x0 + x(one.at, 0), y0 + y(one.at, 0)].map(function (v) {
          return v.toFixed(2); }).join(" ") + ")");
      }
      function move(element, px, py) {
        element.setAttribute("transform", "translate(" + px.toFixed(2) + " " + py.toFixed(2) + ")");
      }
      parts[0].forEach(function (one) {
        ["x1", "y1", "x2", "y2"].forEach(function (name, k) {
          var value = k % 2 ? y0 + y(one.at, k - 1 + (k > 1)) : x0 + x(one.at, k + (k > 1));
          one.element.setAttribute(name, value.toFixed(2));
        });
      });
      parts[1].forEach(function (one) { move(one.element, x0 + x(one.at, 0), y0 + y(one.at, 0)); });
      parts[2].forEach(function (one) { matrix(one, x(one.at, 3), y(one.at, 3), x(one.at, 6), y(one.at, 6)); });
      parts[3].forEach(function (one) {
        var a = 0, b = 0, c = 0;
        [3, 6, 9].forEach(function (k) {
          var u = x(one.at, k), v = y(one.at, k);
          a += u * u; b += u * v; c += v * v;
        });
        var root = Math.sqrt(Math.max(a * c - b * b, 0)), whole = Math.sqrt(a + c + 2 * root) || 1;
        matrix(one, (a + root) / whole, b / whole, b / whole, (c + root) / whole);
      });
      var taken = [], line = 13;
      parts[4].forEach(function (one) {
        var px = x0 + x(one.at, 0), py = y0 + y(one.at, 0);
        while (taken.some(function (q) { return Math.abs(q[0] - px) < line && Math.abs(q[1] - py) < line; })) { py -= line; }
        taken.push([px, py]);
        move(one.element, px, py);
      });
      parts[5].slice().sort(function (one, other) { return dot(towards, one.at, 0) - dot(towards, other.at, 0); })
        .forEach(function (one) { one.element.parentNode.appendChild(one.element); });
    }

    function look(azimuth, elevation, zoom) {
      var limit = Math.PI / 2;
      view = { azimuth: azimuth, elevation: Math.max(-limit, Math.min(limit, elevation)), zoom: Math.max(0.4, Math.min(8, zoom)) };
      if (!asked) { asked = true; window.requestAnimationFrame(draw); }
    }
    function turn(right, up) { look(view.azimuth + right, view.elevation + up, view.zoom); }
    function reset() { look(given[4], given[5], 1); }

    var held = null;
    ground.addEventListener("pointerdown", function (event) {
      if (event.button !== 0) { return; }
      held = [event.clientX, event.clientY];
      ground.setPointerCapture(event.pointerId);
    });
    ground.addEventListener("pointermove", function (event) {
      if (!held) { return; }
      turn((held[0] - event.clientX) * 0.009, (event.clientY - held[1]) * 0.009);
      held = [event.clientX, event.clientY];
    });
    ["pointerup", "pointercancel"].forEach(function (name) { ground.addEventListener(name, function () { held = null; }); });
    ground.addEventListener("dblclick", reset);
    ground.addEventListener("wheel", function (event) {
      if (!event.ctrlKey) { return; } // without it the reader scrolls the page
      event.preventDefault();
      look(view.azimuth, view.elevation, view.zoom * Math.exp(-0.004 * event.deltaY));
    }, { passive: false });

    var step = Math.PI / 24;
    var views = { front: [0, 0], side: [Math.PI / 2, 0], top: [-Math.PI / 2, Math.PI / 2] };
    var moves = {
      ArrowLeft: function () { turn(step, 0); }, ArrowRight: function () { turn(-step, 0); },
      ArrowUp: function () { turn(0, step); }, ArrowDown: function () { turn(0, -step); },
      "+": function () { look(view.azimuth, view.elevation, view.zoom * 1.25); },
      "-": function () { look(view.azimuth, view.elevation, view.zoom / 1.25); }, Home: reset
    };
    moves["="] = moves["+"];
    ground.addEventListener("keydown", function (event) {
      if (event.ctrlKey || event.altKey || event.metaKey || !moves[event.key]) { return; }
      event.preventDefault();
      moves[event.key]();
    });
    figure.querySelectorAll("[data-look]").forEach(function (button) {
      button.addEventListener("click", function () {
        var to = views[button.dataset.look];
        if (to) { look(to[0], to[1], view.zoom); } else { moves[button.dataset.look](); }
      });
    });
    figure.querySelectorAll("[data-shows]").forEach(function (input) {
      function show() { svg.classList.toggle("without-" + input.dataset.shows, !input.checked); }
      input.addEventListener("change", show);
      show();
    });

    // One link alone: pointed at for as long as that lasts, pressed until it is pressed again.
    var buttons = Array.from(figure.querySelectorAll("button[data-number]")), pressed = "";
    function single(number) {
      svg.classList.toggle("singles", number !== "");
      svg.querySelectorAll("[data-link]").forEach(function (group) {
        group.classList.toggle("single", group.dataset.link === number);
      });
    }
    buttons.forEach(function (button) {
      button.addEventListener("pointerenter", function () { single(button.dataset.number); });
      button.addEventListener("pointerleave", function () { single(pressed); });
      button.addEventListener("click", function () {
        pressed = pressed === button.dataset.number ? "" : button.dataset.number;
        buttons.forEach(function (other) { other.setAttribute("aria-pressed", String(other.dataset.number === pressed)); });
        single(pressed);
      });
    });
    figure.querySelectorAll(".controls-of-drawing").forEach(function (controls) { controls.hidden = false; });
    view = { azimuth: given[4], elevation: given[5], zoom: 1 };
    figure.turnTo = look; // for tests, and for pages that turn several drawings together
  }

  document.querySelectorAll(".drawing").forEach(turnable);
})();
