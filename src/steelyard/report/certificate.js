// Verifies a certificate of Steelyard with integers alone: no floating point, no solver, no robot.
// The format and what has to hold are in docs/reference/certificates.md.
(function (root) {
  "use strict";
  var NUMBER = /^[+-]?[0-9]{1,5000}(\.[0-9]{0,5000})?([eE][+-]?[0-9]{1,3})?$|^[+-]?[0-9]{1,5000}\/[0-9]{1,5000}$/;
  var SYMBOLS = ["Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m"];
  var LARGEST = 1000;

  function require(truth, otherwise) { if (!truth) { throw new Error(otherwise); } }

  // JSON, but a key that stands twice is refused, and 1.0 is no index. A number that is no integer stays a text.

  function Inexact(text) { this.text = text; }

  function parse(text) {
    var token = /\s*(?:([{}\[\],:])|("(?:[^"\\\u0000-\u001f]|\\.)*")|(-?(?:0|[1-9]\d*)(?:\.\d+)?(?:[eE][+-]?\d+)?)|(true|false|null))\s*/y;
    function next() {
      var found = token.exec(text);
      require(found, "it is not JSON");
      return found;
    }
    function value(found) {
      if (found[2] !== undefined) { return JSON.parse(found[2]); }
      if (found[3] !== undefined) {
        return /^-?\d+$/.test(found[3]) && Number.isSafeInteger(Number(found[3])) ? Number(found[3]) : new Inexact(found[3]);
      }
      if (found[4] !== undefined) { return JSON.parse(found[4]); }
      if (found[1] === "[") { return items("]", [], function (list, one) { list.push(value(one)); }); }
      require(found[1] === "{", "it is not JSON");
      return items("}", new Map(), function (map, one) {
        require(one[2] !== undefined && next()[1] === ":", "it is not JSON");
        var key = JSON.parse(one[2]);
        require(!map.has(key), "the key " + key + " is there twice");
        map.set(key, value(next()));
      });
    }
    function items(end, made, add) {
      var found = next();
      if (found[1] === end) { return made; }
      for (;;) {
        add(made, found);
        found = next();
        if (found[1] === end) { return made; }
        require(found[1] === ",", "it is not JSON");
        found = next();
      }
    }
    var made = value(next());
    require(token.lastIndex === text.length, "it is not JSON");
    return made;
  }

  // Rational numbers n/d with d > 0.

  function gcd(a, b) {
    if (a < 0n) { a = -a; }
    while (b) { var rest = a % b; a = b; b = rest; }
    return a;
  }
  function rational(text) {
    require(typeof text === "string" && NUMBER.test(text), "what should be a number is none");
    if (text[0] === "+") { text = text.slice(1); }
    var parts = text.split("/");
    if (parts.length === 2) {
      require(BigInt(parts[1]) !== 0n, "a number divides by zero");
      return { n: BigInt(parts[0]), d: BigInt(parts[1]) };
    }
    var mantissa = text.split(/[eE]/), digits = mantissa[0].split(".");
    var places = (digits[1] || "").length - Number(mantissa[1] || 0);
    var n = BigInt(digits[0] + (digits[1] || ""));
    return places > 0 ? { n: n, d: 10n ** BigInt(places) } : { n: n * 10n ** BigInt(-places), d: 1n };
  }
  var ZERO = { n: 0n, d: 1n };
  function add(a, b) {
    if (a.d === b.d) { return { n: a.n + b.n, d: a.d }; }
    if (a.d % b.d === 0n) { return { n: a.n + b.n * (a.d / b.d), d: a.d }; }
    if (b.d % a.d === 0n) { return { n: a.n * (b.d / a.d) + b.n, d: b.d }; }
    var common = gcd(a.d, b.d);
    return { n: a.n * (b.d / common) + b.n * (a.d / common), d: a.d / common * b.d };
  }
  function times(a, b) { return { n: a.n * b.n, d: a.d * b.d }; }
  function minus(a) { return { n: -a.n, d: a.d }; }
  function size(a) { return a.n < 0n ? minus(a) : a; }
  function below(a, b) { return a.n * b.d < b.n * a.d; }
  function same(a, b) { return a.n * b.d === b.n * a.d; }
  function largest(list) { return list.reduce(function (most, one) { return below(most, size(one)) ? size(one) : most; }, ZERO); }
  function half(a) { return { n: a.n, d: 2n * a.d }; }

  // The double nearest to a rational number: 64 bits or more of the quotient, the last of which says whether more follow.
  function double(a) {
    var n = a.n < 0n ? -a.n : a.n;
    if (n === 0n) { return 0; }
    var shift = 70 + a.d.toString(2).length - n.toString(2).length;
    var above = shift > 0 ? n << BigInt(shift) : n, under = shift > 0 ? a.d : a.d << BigInt(-shift);
    var quotient = above / under;
    if (above % under) { quotient |= 1n; }
    var value = Number(quotient);
    for (var left = shift; left; left -= Math.sign(left) * Math.min(Math.abs(left), 1000)) {
      value *= Math.pow(2, -Math.sign(left) * Math.min(Math.abs(left), 1000));
    }
    return a.n < 0n ? -value : value;
  }

  // A symmetric matrix of rational numbers is positive (semi)definite: elimination in integers (Bareiss). Beside a zero
  // on the diagonal of a semidefinite matrix there must be zeros.
  function definite(matrix, strict) {
    var scale = 1n;
    matrix.forEach(function (row) { row.forEach(function (v) { scale = scale / gcd(scale, v.d) * v.d; }); });
    var rows = matrix.map(function (row) { return row.map(function (v) { return v.n * (scale / v.d); }); });
    var previous = 1n, count = rows.length;
    for (var k = 0; k < count; k++) {
      var pivot = rows[k][k];
      if (pivot < 0n || (strict && pivot === 0n)) { return false; }
      if (pivot === 0n) {
        for (var c = k + 1; c < count; c++) { if (rows[k][c] !== 0n) { return false; } }
        continue;
      }
      for (var i = k + 1; i < count; i++) {
        for (var j = i; j < count; j++) {
          rows[i][j] = (pivot * rows[i][j] - rows[k][i] * rows[k][j]) / previous;
          rows[j][i] = rows[i][j];
        }
      }
      previous = pivot;
    }
    return true;
  }

  // Reading the parts of a document, each of its kind.

  function object(value) { require(value instanceof Map, "a part is missing"); return value; }
  function list(value) { require(Array.isArray(value), "a list is missing"); return value; }
  function text(value) { require(typeof value === "string", "a text is missing"); return value; }
  function truth(value) { require(typeof value === "boolean", "true or false is missing"); return value; }
  function index(value, count) {
    require(Number.isInteger(value) && value >= 0 && value < count, "a place is outside");
    return value;
  }
  function row(entries, count) { // [[index, number], ...], each index once
    var found = new Map();
    list(entries).forEach(function (entry) {
      require(list(entry).length === 2 && !found.has(index(entry[0], count)), "a place has too many indices, or is there twice");
      found.set(entry[0], rational(entry[1]));
    });
    return found;
  }
  function elements(entries, count) { // [[row, column, number], ...] with row <= column, each place once
    var seen = new Set();
    return list(entries).map(function (entry) {
      require(list(entry).length === 3 && index(entry[0], count) <= index(entry[1], count), "a place is below the diagonal");
      var place = entry[0] * count + entry[1];
      require(!seen.has(place), "a place is there twice");
      seen.add(place);
      return [entry[0], entry[1], rational(entry[2])];
    });
  }
  function dense(entries, count) {
    var made = Array.from({ length: count }, function () { return new Array(count).fill(ZERO); });
    entries.forEach(function (e) { made[e[0]][e[1]] = made[e[1]][e[0]] = add(made[e[0]][e[1]], e[2]); });
    return made;
  }
  function dot(coefficients, values) {
    var sum = ZERO;
    coefficients.forEach(function (value, place) { sum = add(sum, times(value, values[place])); });
    return sum;
  }
  function inner(entries, Z) { // an element off the diagonal is named once, and stands at both places
    return entries.reduce(function (sum, e) {
      var product = times(e[2], Z[e[0]][e[1]]);
      return add(sum, e[0] === e[1] ? product : { n: 2n * product.n, d: product.d });
    }, ZERO);
  }

  function* statementOf(document) {
    var given = object(document.get("statement"));
    var names = list(given.get("parameter_names")).map(text), count = names.length;
    require(new Set(names).size === count, "two parameters share a name");
    text(given.get("robot"));
    var made = { names: names, consistency: text(given.get("consistency")), conditions: [], equations: [],
      base: list(given.get("base")).map(rational), rows: [], expressions: list(given.get("base_expressions")).map(text) };
    require(made.consistency === "full" || made.consistency === "inertia", "nothing defines its consistency");
    for (var entries of list(given.get("base_map"))) { made.rows.push(row(entries, count)); yield; }
    require(made.base.length === made.rows.length && made.base.length === made.expressions.length, "base parameters are missing");
    for (var entry of list(given.get("conditions"))) {
      var order = object(entry).get("size");
      require(Number.isInteger(order) && order > 0 && order <= LARGEST, "a condition has no size");
      var coefficients = new Map();
      list(entry.get("coefficients")).forEach(function (pair) {
        require(list(pair).length === 2 && !coefficients.has(index(pair[0], count)), "a parameter is twice in a condition");
        coefficients.set(pair[0], elements(pair[1], order));
      });
      made.conditions.push({ name: text(entry.get("name")), size: order, strict: truth(entry.get("strict")),
        physical: truth(entry.get("physical")), constant: elements(entry.get("constant"), order), coefficients: coefficients });
      yield;
    }
    list(given.get("equations")).forEach(function (e) {
      var one = { name: text(object(e).get("name")), coefficients: row(e.get("coefficients"), count),
        value: rational(e.get("value")), tolerance: rational(e.get("tolerance")) };
      require(one.tolerance.n >= 0n, "a tolerance is negative");
      made.equations.push(one);
    });
    return made;
  }

  function bodyMatrix(p, consistency) {
    var xx = p[0], xy = p[1], xz = p[2], yy = p[3], yz = p[4], zz = p[5], x = p[6], y = p[7], z = p[8], m = p[9], o = ZERO;
    if (consistency === "full") {
      var trace = half(add(add(xx, yy), zz));
      var diagonal = [xx, yy, zz].map(function (v) { return add(trace, minus(v)); });
      return [[diagonal[0], minus(xy), minus(xz), x], [minus(xy), diagonal[1], minus(yz), y],
        [minus(xz), minus(yz), diagonal[2], z], [x, y, z, m]];
    }
    return [[xx, xy, xz, o, minus(z), y], [xy, yy, yz, z, o, minus(x)], [xz, yz, zz, minus(y), x, o],
      [o, z, minus(y), m, o, o], [minus(z), o, x, o, m, o], [y, minus(x), o, o, o, m]];
  }

  function* feasible(statement, proof) {
    var delta = list(proof.get("parameters")).map(rational), places = new Map(), bodies = 0;
    require(delta.length === statement.names.length, "it has another number of parameters");
    statement.names.forEach(function (name, place) { places.set(name, place); });
    for (var k = 0; k < statement.rows.length; k++) {
      require(same(dot(statement.rows[k], delta), statement.base[k]), "its parameters do not have the base parameter " + statement.expressions[k]);
      yield;
    }
    for (var equation of statement.equations) {
      var scale = largest(Array.from(equation.coefficients.values()).concat([equation.value]));
      require(!below(times(scale, { n: 1n, d: 1000000000n }), equation.tolerance), equation.name + " may be missed by too much");
      var missed = size(add(dot(equation.coefficients, delta), minus(equation.value)));
      require(!below(equation.tolerance, missed), equation.name + " does not hold");
    }
    for (var condition of statement.conditions) {
      var matrix = dense(condition.constant, condition.size);
      condition.coefficients.forEach(function (entries, place) {
        entries.forEach(function (e) {
          matrix[e[0]][e[1]] = matrix[e[1]][e[0]] = add(matrix[e[0]][e[1]], times(e[2], delta[place]));
        });
      });
      require(definite(matrix, condition.strict), condition.name + " does not hold");
      yield;
    }
    for (var name of statement.names) {
      if (!name.startsWith("Lxx")) { continue; }
      var own = SYMBOLS.map(function (symbol) {
        var place = places.get(symbol + name.slice(3));
        require(place !== undefined, "it does not name the ten inertial parameters of each body");
        return delta[place];
      });
      require(definite(bodyMatrix(own, statement.consistency), true), "body " + name.slice(3) + " cannot exist");
      bodies++;
      yield;
    }
    require(bodies, "it is about no body");
    return { verdict: "feasible", bodies: bodies, parameters: delta };
  }

  function* infeasible(statement, proof) {
    var y = list(proof.get("direction")).map(rational), multipliers = list(proof.get("multipliers")).map(rational);
    var shift = rational(proof.get("shift")), value = ZERO, touches = false, seen = new Set();
    require(y.length === statement.base.length && multipliers.length === statement.equations.length, "its dual point does not fit");
    require(shift.n >= 0n, "its shift is negative");
    var left = statement.names.map(function () { return ZERO; });
    for (var entry of list(proof.get("duals"))) {
      require(list(entry).length === 2 && !seen.has(index(entry[0], statement.conditions.length)), "a condition has two dual matrices");
      seen.add(entry[0]);
      var condition = statement.conditions[entry[0]], Z = dense(elements(entry[1], condition.size), condition.size);
      var shifted = Z.map(function (line, i) {
        return line.map(function (v, j) { return i === j && condition.physical ? add(v, shift) : v; });
      });
      require(definite(shifted, false), "the dual matrix of " + condition.name + " is not positive semidefinite");
      touches = touches || (condition.strict && Z.some(function (line) { return line.some(function (v) { return v.n !== 0n; }); }));
      value = add(value, inner(condition.constant, Z));
      condition.coefficients.forEach(function (entries, place) { left[place] = add(left[place], inner(entries, Z)); });
      yield;
    }
    statement.equations.forEach(function (equation, e) {
      var multiplier = multipliers[e];
      value = add(value, add(times(size(multiplier), equation.tolerance), minus(times(multiplier, equation.value))));
      equation.coefficients.forEach(function (c, place) { left[place] = add(left[place], times(multiplier, c)); });
    });
    for (var k = 0; k < y.length; k++) {
      value = add(value, times(y[k], statement.base[k]));
      statement.rows[k].forEach(function (c, place) { left[place] = add(left[place], minus(times(y[k], c))); });
      yield;
    }
    left.forEach(function (rest, place) { require(rest.n === 0n, "its dual point is not orthogonal to changes of " + statement.names[place]); });
    require(value.n < 0n || (value.n === 0n && touches && shift.n === 0n), "it contradicts nothing");
    var reach = largest(statement.base.map(function (b) { return times(b, { n: 10000n, d: 1n }); }).concat([{ n: 1000000n, d: 1n }]));
    require(!below(minus(value), times(shift, reach)), "it does not reach far enough");
    return { verdict: "infeasible", bound: shift.n === 0n ? null : double({ n: -value.n * shift.d, d: value.d * shift.n }) };
  }

  // The steps of a verification, so that a page can do something else between them; an error says why it is no proof.
  function* verification(content) {
    var whole = object(parse(content));
    var inside = whole.get("certificate"), certificate = inside instanceof Map ? inside : whole;
    require(certificate.get("format") === "steelyard-certificate-1", "its format is another");
    var statement = yield* statementOf(certificate), proof = object(certificate.get("proof")), found;
    if (certificate.get("verdict") === "feasible") {
      found = yield* feasible(statement, proof);
    } else {
      require(certificate.get("verdict") === "infeasible", "its verdict is neither");
      found = yield* infeasible(statement, proof);
    }
    found.statement = statement;
    if (certificate !== whole) { agrees(whole, statement, found); }
    return found;
  }

  // The numbers of an estimate are the doubles nearest to the exact ones.
  function agrees(estimate, statement, found) {
    require(found.verdict === "feasible", "it is about no feasible estimate");
    require(estimate.get("consistency") === statement.consistency, "the estimate has another consistency");
    [["parameter_names", statement.names], ["base_expressions", statement.expressions]].forEach(function (pair) {
      require(JSON.stringify(list(estimate.get(pair[0]))) === JSON.stringify(pair[1]), "the estimate has other " + pair[0]);
    });
    [["parameters", found.parameters], ["base", statement.base]].forEach(function (pair) {
      var given = list(estimate.get(pair[0]));
      require(given.length === pair[1].length, "the estimate has another number of " + pair[0]);
      given.forEach(function (value, k) {
        var number = value instanceof Inexact ? Number(value.text) : value;
        require(number === double(pair[1][k]), "the estimate has other " + pair[0]);
      });
    });
  }

  // Whether a text such as 0.123, which is printed with so many digits, is this exact number.
  function shows(printed, exact) {
    if (!NUMBER.test(printed) || printed.includes("/")) { return false; }
    var digits = printed.split(/[eE]/), places = (digits[0].split(".")[1] || "").length - Number(digits[1] || 0);
    var unit = places > 0 ? { n: 1n, d: 10n ** BigInt(places) } : { n: 10n ** BigInt(-places), d: 1n };
    return !below(half(unit), size(add(rational(printed), minus(exact))));
  }

  function verify(content) { // the whole at once
    var steps = verification(content), step;
    try {
      do { step = steps.next(); } while (!step.done);
      return { valid: true, found: step.value };
    } catch (error) {
      return { valid: false, reason: error.message };
    }
  }

  root.steelyardCertificate = { verify: verify, verification: verification, shows: shows };
})(globalThis);
