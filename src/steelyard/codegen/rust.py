"""Rust: a crate without the standard library, without dependencies and without unsafe code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .assignments import Listing, Part, Store, Syntax, listing, partition
from .documentation import MARKDOWN, elements_lines, function_lines, readme
from .naming import DEVICE_NAMES, NamedFunction, naming, project_name, shadowing, shared_arguments
from .project import Project, SourceWriter
from .reference import Reference
from .text import Names, markdown_text, marker, number, number_lines, wrapped_lines

if TYPE_CHECKING:
    from steelyard.graph import Output

__all__ = ["EXPONENTIAL", "SQUARE_ROOT", "TRIGONOMETRY", "write"]

# Half the exponent is a first guess within 4 percent; each of Heron's steps doubles the correct digits.
SQUARE_ROOT = """
//! Square root: of the standard library, or in plain arithmetic where there is none.

#[cfg(feature = "std")]
extern crate std;

#[cfg(feature = "std")]
pub(crate) fn sqrt(x: f64) -> f64 {
    x.sqrt()
}

/// Within one unit in the last place; not a number where `x` is negative or not a number.
#[cfg(not(feature = "std"))]
pub(crate) fn sqrt(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return if x < 0.0 { f64::NAN } else { x };
    }
    let (x, scale) = if x < 1.0e-290 {
        (x * 3.402823669209385e38, 5.421010862427522e-20)
    } else {
        (x, 1.0)
    };
    let mut root = f64::from_bits((x.to_bits() >> 1) + 0x1ff7_a3be_a91d_9b1b);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root * scale
}
"""

# Taylor's series: of exp(r) with |r| up to ln(2)/2, and of log(m) in s = (m - 1) / (m + 1) with m up to sqrt(2).
EXPONENTIAL = """
//! Exponential and natural logarithm: of the standard library, or in plain arithmetic where there is none.
#![allow(dead_code)]

#[cfg(feature = "std")]
extern crate std;

#[cfg(feature = "std")]
pub(crate) fn exp(x: f64) -> f64 {
    x.exp()
}

#[cfg(feature = "std")]
pub(crate) fn log(x: f64) -> f64 {
    x.ln()
}

#[cfg(not(feature = "std"))]
const LN_2_HIGH: f64 = 6.93147180369123816490e-01;
#[cfg(not(feature = "std"))]
const LN_2_LOW: f64 = 1.90821492927058770002e-10;

/// Within two units in the last place.
#[cfg(not(feature = "std"))]
pub(crate) fn exp(x: f64) -> f64 {
    if !(x > -746.0 && x < 710.0) {
        return if x <= -746.0 { 0.0 } else { x + f64::INFINITY };
    }
    let turns = x * core::f64::consts::LOG2_E;
    let whole = (if turns < 0.0 { turns - 0.5 } else { turns + 0.5 }) as i64;
    let (high, low) = (x - whole as f64 * LN_2_HIGH, whole as f64 * LN_2_LOW);
    let r = high - low;
    let mut tail = 0.0;
    let mut k = 13;
    while k >= 2 {
        tail = (tail + 1.0) * r / k as f64;
        k -= 1;
    }
    let value = 1.0 + (r + (r * tail + ((high - r) - low)));
    let half = whole / 2;
    value * f64::from_bits(((half + 1023) as u64) << 52) * f64::from_bits(((whole - half + 1023) as u64) << 52)
}

/// Within two units in the last place; not a number where `x` is negative or not a number.
#[cfg(not(feature = "std"))]
pub(crate) fn log(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return if x == 0.0 { -f64::INFINITY } else if x < 0.0 { f64::NAN } else { x };
    }
    let (x, shift) = if x < 2.2250738585072014e-308 { (x * 18014398509481984.0, 54) } else { (x, 0) };
    let bits = x.to_bits() as i64;
    let exponent = (bits - core::f64::consts::FRAC_1_SQRT_2.to_bits() as i64) >> 52;
    let m = f64::from_bits((bits - (exponent << 52)) as u64);
    let power = (exponent - shift) as f64;
    let s = (m - 1.0) / (m + 1.0);
    let square = s * s;
    let mut series = 0.0;
    let mut k = 23;
    while k >= 3 {
        series = square * (2.0 / k as f64 + series);
        k -= 2;
    }
    power * LN_2_HIGH + (2.0 * s + (s * series + power * LN_2_LOW))
}
"""


# Sine and cosine in Rust for computers without a standard library.

# Reduction by a multiple of pi/2 in three parts (33, 33 and 53 bits: the products with the first two are exact), then
# Taylor series on [-pi/4, pi/4] to orders 17 and 16, with the reduced angle as a sum of two numbers.
TRIGONOMETRY = """
//! Sine and cosine: of the standard library, or in plain arithmetic where there is none.

#[cfg(feature = "std")]
extern crate std;

#[cfg(feature = "std")]
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    x.sin_cos()
}

/// Within 1e-15 up to a million radians; beyond, and where `x` is not a number, the results are not numbers.
#[cfg(not(feature = "std"))]
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    if !(x > -1.0e6 && x < 1.0e6) {
        return (f64::NAN, f64::NAN);
    }
    let turns = x * core::f64::consts::FRAC_2_PI;
    let quadrant = (if turns < 0.0 { turns - 0.5 } else { turns + 0.5 }) as i32;
    let whole = f64::from(quadrant);
    let (high, error) = difference(x - whole * 1.5707963267341256, whole * 6.077100506303966e-11);
    let (r, low) = difference(high, whole * 2.0222662487959506e-21 - error);

    let square = r * r;
    let mut sine = 2.8114572543455206e-15;
    sine = sine * square - 7.647163731819816e-13;
    sine = sine * square + 1.6059043836821613e-10;
    sine = sine * square - 2.505210838544172e-08;
    sine = sine * square + 2.7557319223985893e-06;
    sine = sine * square - 0.0001984126984126984;
    sine = sine * square + 0.008333333333333333;
    sine = sine * square - 0.16666666666666666;
    sine = r + (r * square * sine + low * (1.0 - 0.5 * square));

    let mut cosine = 4.779477332387385e-14;
    cosine = cosine * square - 1.1470745597729725e-11;
    cosine = cosine * square + 2.08767569878681e-09;
    cosine = cosine * square - 2.755731922398589e-07;
    cosine = cosine * square + 2.48015873015873e-05;
    cosine = cosine * square - 0.001388888888888889;
    cosine = cosine * square + 0.041666666666666664;
    let main = 1.0 - 0.5 * square;
    let lost = (1.0 - main) - 0.5 * square;
    cosine = main + (square * square * cosine + lost - r * low);

    match quadrant & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// Return a - b rounded, and what the rounding lost.
#[cfg(not(feature = "std"))]
fn difference(a: f64, b: f64) -> (f64, f64) {
    let result = a - b;
    let part = a - result;
    (result, (a - (result + part)) + (part - b))
}
"""


# Rust: a crate without the standard library, without dependencies and without unsafe code.

_SIGN = "steelyard_sign"
_KEYWORDS = """
as break const continue crate else enum extern false fn for if impl in let loop match mod move mut pub ref return self
Self static struct super trait true type unsafe use where while async await dyn abstract become box do final macro
override priv typeof unsized virtual yield try gen union raw safe macro_rules bool char str i8 i16 i32 i64 i128 isize
u8 u16 u32 u64 u128 usize f16 f32 f64 f128 main trigonometry
"""
_RESERVED = frozenset(_KEYWORDS.split())
_CRATES = """
test core std alloc proc_macro libm build deps examples incremental bench
"""
_PROJECT_RESERVED = _RESERVED | DEVICE_NAMES | frozenset(_CRATES.split())


class _Source(SourceWriter):
    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self.name = project_name(project, _PROJECT_RESERVED)
        self.scope = Names(_RESERVED | {_SIGN})
        names = naming(project, self.scope, style=str.upper)
        self.functions, self.sizes = shadowing(names, _RESERVED | {_SIGN}), names.sizes
        self.syntax = Syntax(
            calls={
                "sin": "trigonometry::sin_cos({}).0",
                "cos": "trigonometry::sin_cos({}).1",
                "sign": f"{_SIGN}({{}})",
                "sqrt": "square_root::sqrt({})",
                "exp": "exponential::exp({})",
                "log": "exponential::log({})",
            },
            pair=("({}, {})", "trigonometry::sin_cos({})"),
        )
        self.listings: list[Listing] = [listing(f.function, self.syntax, f.names, f.scope) for f in self.functions]
        self.operations = frozenset[str]().union(*(found.operations for found in self.listings))

    def files(self) -> dict[str, str]:
        described = {
            "Cargo.toml": "the crate, without dependencies",
            "src/lib.rs": "the functions, their sizes, and what every argument is",
            "tests/reference.rs": "self-test with reference values",
        }
        result = {
            "Cargo.toml": self._manifest(),
            "src/lib.rs": self._library(),
            "tests/reference.rs": self._test(),
        }
        if self.operations & {"sin", "cos"}:
            described["src/trigonometry.rs"] = "sine and cosine with and without the standard library"
            result["src/trigonometry.rs"] = f"// {marker(self.project.version)}{TRIGONOMETRY}"
        if "sqrt" in self.operations:
            described["src/square_root.rs"] = "square root with and without the standard library"
            result["src/square_root.rs"] = f"// {marker(self.project.version)}{SQUARE_ROOT}"
        if self.operations & {"exp", "log"}:
            described["src/exponential.rs"] = "exponential and logarithm with and without the standard library"
            result["src/exponential.rs"] = f"// {marker(self.project.version)}{EXPONENTIAL}"
        text = readme(self.project, "Rust", described, self._use(), self.functions, self.syntax.element)
        return {**result, "README.md": text}

    def _manifest(self) -> str:
        return "\n".join(
            [
                f"# {marker(self.project.version)}",
                "[package]",
                f'name = "{self.name}"',
                'version = "0.1.0"',
                'edition = "2021"',
                "publish = false",
                "",
                "[features]",
                'default = ["std"]',
                "# Sines, roots and exponentials of the standard library; without it, the crate's own.",
                "std = []",
                "",
            ]
        )

    def _library(self) -> str:
        project = self.project
        introduction = [
            markdown_text(project.name),
            "",
            markdown_text(project.description),
            "",
            "Every function reads arrays and writes arrays; it allocates nothing and keeps nothing. Matrices are "
            "stored row by row.",
        ]
        elements = elements_lines(project, self.functions, self.syntax.element, prose=MARKDOWN)
        lines = [f"// {marker(project.version)}", *wrapped_lines([*introduction, "", *elements], "//! ")]
        lines += [
            "",
            "#![no_std]",
            "#![deny(warnings)]",
            "#![forbid(unsafe_code)]",
            "#![allow(non_snake_case, clippy::all, rustdoc::bare_urls)]",
            "",
        ]
        lines += ["mod exponential;", ""] if self.operations & {"exp", "log"} else []
        lines += ["mod square_root;", ""] if "sqrt" in self.operations else []
        lines += ["mod trigonometry;", ""] if self.operations & {"sin", "cos"} else []
        for size in self.sizes.declared:
            lines += wrapped_lines([markdown_text(size.description)], "/// ") if size.description else []
            kind = "f64" if isinstance(size.value, float) else "usize" if size.value >= 0 else "i64"
            lines.append(f"pub const {size.name}: {kind} = {size.literal};")
        lines.append("")
        if "sign" in self.operations:
            lines += [
                f"fn {_SIGN}(x: f64) -> f64 {{",
                "    if x > 0.0 {",
                "        1.0",
                "    } else if x < 0.0 {",
                "        -1.0",
                "    } else {",
                "        x + 0.0",
                "    }",
                "}",
                "",
            ]
        shared = shared_arguments(project)
        for named, found in zip(self.functions, self.listings, strict=True):
            text = function_lines(named.function, named.names, self.syntax.element, shared, prose=MARKDOWN)
            lines += [*self._function(named, found, wrapped_lines(text, "/// ")), ""]
        return "\n".join(lines).rstrip("\n") + "\n"

    def _function(self, named: NamedFunction, found: Listing, documentation: list[str]) -> list[str]:
        function, cut = named.function, partition(found)
        parameters = {}
        for argument in function.arguments:
            size = self.sizes.of[function.name, argument.name]
            parameters[named.names[argument.name]] = f"&[f64; {size}]"
        for output in function.outputs:
            parameters[named.names[output.name]] = f"&mut {self._output_type(named, output)}"
        unused = [a.name for a in function.arguments if a.name not in found.used_arguments]
        body = [f"    let _ = {named.names[name]};" for name in unused]
        outputs = named.output_names
        for name, elements in zip(outputs, found.outputs, strict=True):
            body += [f"    *{name} = [0.0; {len(elements.elements)}];"] if elements.mostly_zero else []
        head = [*documentation, *_head(f"pub fn {named.name}", parameters)]
        if len(cut.parts) == 1:
            return [*head, *body, *_statements(named, cut.parts[0], ""), "}"]
        kept = named.scope.inner().take("kept")
        lines = ["// A long function is cut into parts, because compilers take very long over one that is whole."]
        body += [f"    let mut {kept} = [0.0; {cut.places}];"] if cut.places else []
        for k, part in enumerate(cut.parts):
            name = self.scope.take(f"{named.name}_part_{k + 1}")
            needed = part.names | {outputs[j] for j in part.stored}
            passed = {key: text for key, text in parameters.items() if key in needed}
            values = list(passed)
            if part.reads or part.keeps:
                passed[kept] = f"&mut [f64; {cut.places}]"
                values.append(f"&mut {kept}")
            lines += ["#[inline(never)]", *_head(f"fn {name}", passed), *_statements(named, part, kept), "}", ""]
            body.append(f"    {name}({', '.join(values)});")
        return [*lines, *head, *body, "}"]

    def _output_type(self, named: NamedFunction, output: Output) -> str:
        return f"[f64; {self.sizes.of[named.function.name, output.name]}]" if output.shape else "f64"

    def _test(self) -> str:
        lines = [
            f"// {marker(self.project.version)}",
            "// Each function must give its reference values.",
            "#![allow(non_snake_case)]",
            "",
            "fn differences(what: &str, sample: usize, actual: &[f64], expected: &[f64], tolerance: f64) -> usize {",
            "    let mut count = 0;",
            "    for (i, (a, e)) in actual.iter().zip(expected).enumerate() {",
            "        if !((a - e).abs() <= tolerance) {",
            "            count += 1;",
            "            if count <= 5 {",
            '                println!("{what}[{i}] of sample {sample} is {a}, expected {e} within {tolerance}");',
            "            }",
            "        }",
            "    }",
            "    count",
            "}",
        ]
        for named in self.functions:
            lines += ["", *self._test_function(named, self.project.references[named.function.name])]
        return "\n".join(lines) + "\n"

    def _test_function(self, named: NamedFunction, reference: Reference) -> list[str]:
        function = named.function
        lines = ["#[test]", f"fn {named.name}_gives_its_reference_values() {{"]
        for k, values in enumerate(reference.inputs):
            lines += _table(f"INPUT_{k + 1}", values)
        for k, values in enumerate(reference.outputs):
            lines += _table(f"EXPECTED_{k + 1}", values)
        lines += ["    let mut count = 0;", f"    for sample in 0..{reference.samples} {{"]
        passed = [f"&INPUT_{k + 1}[sample]" for k in range(len(reference.inputs))]
        for k, output in enumerate(function.outputs):
            passed.append(f"&mut actual_{k + 1}")
            value = f"[f64::INFINITY; {output.size}]" if output.shape else "f64::INFINITY"
            lines.append(f"        let mut actual_{k + 1} = {value};")
        lines.append(f"        {self.name}::{named.name}({', '.join(passed)});")
        for k, (output, tolerance) in enumerate(zip(function.outputs, reference.tolerances, strict=True)):
            actual = f"&actual_{k + 1}" if output.shape else f"&[actual_{k + 1}]"
            lines.append(f'        count += differences("{named.names[output.name]}", sample, {actual},')
            lines.append(f"            &EXPECTED_{k + 1}[sample], {number(tolerance)});")
        return [*lines, "    }", '    assert_eq!(count, 0, "{count} values differ");', "}"]

    def _use(self) -> list[str]:
        named = self.functions[0]
        lines, passed = [], [f"&{named.names[a.name]}" for a in named.function.arguments]
        for output in named.function.outputs:
            name = named.names[output.name]
            size = f"{self.name}::{self.sizes.of[named.function.name, output.name]}"
            lines.append(f"let mut {name} = [0.0; {size}];" if output.shape else f"let mut {name} = 0.0;")
            passed.append(f"&mut {name}")
        return [
            f'Add the crate by its path: `{self.name} = {{ path = "..." }}`. It depends on nothing, so it builds and',
            "tests without a network:",
            "",
            "```sh",
            "cargo test",
            "```",
            "",
            "```rust",
            *lines,
            f"{self.name}::{named.name}({', '.join(passed)});",
            "```",
            "",
            "The crate is `no_std`, allocates nothing and holds no unsafe code. Its feature `std`, on by default, only",
            "takes sine and cosine from the standard library. With `default-features = false` they are computed by the",
            "crate itself, within 1e-15 for angles up to a million radians.",
        ]


write = _Source.write


def _head(name: str, parameters: Mapping[str, str]) -> list[str]:
    return [f"{name}(", *(f"    {key}: {text}," for key, text in parameters.items()), ") {"]


def _statements(named: NamedFunction, part: Part, kept: str) -> list[str]:
    lines = [f"    let {name} = {kept}[{place}];" for name, place in part.reads]
    for statement in part.statements:
        if isinstance(statement, Store):
            output = named.function.outputs[statement.output]
            name = named.names[output.name]
            target = f"{name}[{statement.element}]" if output.shape else f"*{name}"
            lines.append(f"    {target} = {statement.expression};")
        else:
            lines.append(f"    let {statement.name} = {statement.expression};")
    return [*lines, *(f"    {kept}[{place}] = {name};" for name, place in part.keeps)]


def _table(name: str, values: NDArray[np.float64]) -> list[str]:
    lines = [f"    static {name}: [[f64; {values.shape[1]}]; {len(values)}] = ["]
    for row in values:
        lines += ["        [", *number_lines(row, "            "), "        ],"]
    return [*lines, "    ];"]
