(function () {
  "use strict";
  // What is folded away is printed, too.
  var opened = [];
  window.addEventListener("beforeprint", function () {
    opened = Array.from(document.querySelectorAll("details:not([open])"));
    opened.forEach(function (one) { one.open = true; });
  });
  window.addEventListener("afterprint", function () {
    opened.forEach(function (one) { one.open = false; });
  });

  // Rows of tables by what their numbers rest on.
  document.querySelectorAll(".basis-filter").forEach(function (controls) {
    var inputs = Array.from(controls.querySelectorAll("input"));
    var section = controls.closest("section");
    function filter() {
      inputs.forEach(function (input) {
        section.querySelectorAll("tr .basis." + input.value).forEach(function (badge) {
          badge.closest("tr").classList.toggle("filtered", !input.checked);
        });
      });
    }
    inputs.forEach(function (input) { input.addEventListener("change", filter); });
    controls.hidden = false;
  });
})();
