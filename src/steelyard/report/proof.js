// Verifies the proofs in the page, in steps between which the reader can scroll, and says what was checked.
(function () {
  "use strict";
  var SLICE = 12; // ms

  function inflated(element) {
    var bytes = Uint8Array.from(atob(element.textContent.trim()), function (c) { return c.charCodeAt(0); });
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).text();
  }
  function verified(text) {
    var steps = steelyardCertificate.verification(text);
    return new Promise(function (done, fail) {
      (function on() {
        try {
          for (var end = performance.now() + SLICE; performance.now() < end;) {
            var step = steps.next();
            if (step.done) { done(step.value); return; }
          }
        } catch (error) { fail(error); return; }
        setTimeout(on);
      })();
    });
  }

  // Every number that a table of this page prints of what the proof is about, beside the exact one.
  function printed(found, role) {
    var exact = new Map(), cells = [];
    function cell(row, column) { return row.querySelectorAll("td")[column]; }
    function heads(table) {
      return Array.from(table.querySelectorAll("thead th")).map(function (th) { return th.textContent.trim(); });
    }
    var base = document.getElementById("base-parameters");
    if (base) {
      var column = heads(base).indexOf(role === "answer" ? "Feasible" : "Least squares") - 1;
      base.querySelectorAll("tbody tr").forEach(function (row, k) {
        var name = row.querySelector("th code").textContent;
        cells.push([name, name === found.statement.expressions[k] ? found.statement.base[k] : null, cell(row, column)]);
      });
    }
    if (found.parameters && role === "answer") {
      found.statement.names.forEach(function (name, k) { exact.set(name, found.parameters[k]); });
      var all = document.getElementById("all-parameters");
      if (all) {
        all.querySelectorAll("tbody tr").forEach(function (row) {
          var name = row.querySelector("th").textContent.trim();
          if (exact.has(name)) { cells.push([name, exact.get(name), cell(row, heads(all).indexOf("Value") - 1)]); }
        });
      }
    }
    return cells;
  }

  function sentence(found, cells) {
    var count = found.statement.conditions.length + found.statement.equations.length;
    var conditions = count === 1 ? "the one condition" : "all " + count + " conditions";
    var text = found.verdict === "feasible"
      ? "it is proved that the parameters of this answer have its base parameters exactly, make " + found.bodies +
        (found.bodies === 1 ? " possible body" : " possible bodies") + " under \u201c" + found.statement.consistency +
        "\u201d consistency, and satisfy " + conditions + " stated."
      : "it is proved that no parameters with the base parameters of plain least squares satisfy " + conditions + " stated" +
        (found.bound === null ? "." : ", as far as the traces of their matrices add to less than " + found.bound.toPrecision(3) + ".");
    if (cells.length) {
      text += " The " + cells.length + " numbers that the tables of this page show of them are the proved ones, to the digits shown.";
    }
    return text;
  }

  function check(place) {
    var source = document.getElementById(place.dataset.certificate), role = place.dataset.role, begin = 0;
    inflated(source).then(function (text) {
      begin = performance.now();
      save(place, text);
      return verified(text);
    }).then(function (found) {
      if (found.verdict !== place.dataset.verdict) { throw new Error("it proves that the base parameters are " + found.verdict); }
      var cells = printed(found, role);
      cells.forEach(function (one) {
        var shown = one[2] ? one[2].textContent.trim() : "";
        if (!one[1] || !steelyardCertificate.shows(shown, one[1])) {
          throw new Error("this page shows " + one[0] + " as " + shown + ", which is not the number that is proved");
        }
      });
      var time = Math.max(1, Math.round(performance.now() - begin));
      tell(place, "good", "\u2713 Checked by this page, in exact arithmetic and " + time + " ms: " + sentence(found, cells));
      place.dataset.checked = "valid";
      place.dataset.numbers = cells.length;
    }).catch(function (error) {
      tell(place, "bad", "\u2715 Checked by this page: this is no proof, for " + error.message + ". Do not rely on it.");
      place.dataset.checked = "refused";
    });
  }
  function tell(place, kind, text) {
    place.textContent = text;
    place.className = "proof " + kind;
  }
  function save(place, text) {
    var link = place.parentNode.querySelector("a.save");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.hidden = false;
  }

  if (!window.DecompressionStream) { return; }
  document.querySelectorAll(".proof[data-certificate]").forEach(check);
})();
