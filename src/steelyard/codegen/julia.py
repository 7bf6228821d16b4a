"""Julia: a package of functions that write into arrays."""

from __future__ import annotations

import uuid

import numpy as np
from numpy.typing import NDArray

from .assignments import Syntax, listing
from .documentation import MARKDOWN, elements_lines, function_lines, readme
from .naming import NamedFunction, naming, project_name, shadowing, shared_arguments
from .project import Project, SourceWriter
from .text import Names, comment_lines, indices_from_one, marker, number, number_lines, wrapped_lines

__all__ = ["write"]

_KEYWORDS = """
abstract baremodule begin break catch const continue do else elseif end export false finally for function global if
import in isa let local macro module mutable outer primitive public quote return struct true try type using where while
sin cos sign sqrt sincos length size throw fill pi im Inf NaN Float64 AbstractVector AbstractMatrix AbstractArray Ref
exp log Base Core Main DimensionMismatch nothing missing eval include one zero ans ccall cglobal
"""
_RESERVED = frozenset(_KEYWORDS.split())
_PACKAGES = """
Base Core Main Test Pkg ArgTools Artifacts Base64 CRC32c Dates Distributed Downloads FileWatching Future
InteractiveUtils LazyArtifacts LibGit2 Libdl LinearAlgebra Logging Markdown Mmap Printf Profile Random Serialization
Sockets SparseArrays Statistics StyledStrings SuiteSparse Tar Unicode
"""
_MODULES = frozenset(_PACKAGES.split())
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "steelyard")


class _Source(SourceWriter):
    def __init__(self, project: Project) -> None:
        super().__init__(project)
        words = project_name(project, _RESERVED).split("_")
        self.module = "".join(word.capitalize() for word in words)
        if self.module in _MODULES:
            self.module += "Robot"
        found = naming(project, Names(_RESERVED | {self.module}), style=str.upper)
        self.functions, self.sizes = shadowing(found, _RESERVED | {self.module}), found.sizes
        self.syntax = Syntax(element=lambda name, index: f"{name}[{index + 1}]", pair=("({}, {})", "sincos({})"))

    def files(self) -> dict[str, str]:
        source, test = f"src/{self.module}.jl", "test/runtests.jl"
        described = {
            "Project.toml": "the package, without dependencies",
            source: "the functions, their sizes, and what every argument is",
            test: "self-test with reference values",
        }
        layout = "Outputs come first and are overwritten; matrices are matrices, and a number is a `Ref{Float64}`."
        named = [NamedFunction(f.function, f"{f.name}!", f.names, f.scope) for f in self.functions]
        text = readme(self.project, "Julia", described, self._use(), named, self.syntax.element, layout)
        module = self._module()
        return {"Project.toml": self._manifest(module), source: module, test: self._test(), "README.md": text}

    def _manifest(self, content: str) -> str:
        identity = uuid.uuid5(_NAMESPACE, f"{self.module}\n{content}")
        return "\n".join(
            [
                f"# {marker(self.project.version)}",
                f'name = "{self.module}"',
                f'uuid = "{identity}"',
                'version = "0.1.0"',
                "",
                "[compat]",
                'julia = "1.6"',
                "",
                "[extras]",
                'Test = "8dfed614-e22c-5e08-85e1-65c5234f0b40"',
                "",
                "[targets]",
                'test = ["Test"]',
                "",
            ]
        )

    def _module(self) -> str:
        project = self.project
        elements = elements_lines(project, self.functions, self.syntax.element)
        text = [
            project.name or self.module,
            "",
            project.description,
            "",
            "Every function writes into its first arguments, which must not share memory with the others; it allocates "
            "nothing and keeps nothing. Arrays of another size raise DimensionMismatch.",
            "",
            *elements,
        ]
        lines = [f"# {marker(project.version)}", "#", *comment_lines(text, "# "), f"module {self.module}", ""]
        exported = [*(f"{f.name}!" for f in self.functions), *(s.name for s in self.sizes.declared)]
        lines += [f"export {name}" for name in exported]
        lines.append("")
        for size in self.sizes.declared:
            lines += comment_lines([size.description], "# ") if size.description else []
            lines.append(f"const {size.name} = {size.literal}")
        for named in self.functions:
            lines += ["", *self._function(named)]
        return "\n".join([*lines, "", "end", ""])

    def _function(self, named: NamedFunction) -> list[str]:
        function, names = named.function, named.names
        found = listing(function, self.syntax, names, named.scope)
        shared = shared_arguments(self.project)
        lines = ['@doc raw"""', f"    {named.name}!({', '.join(self._arguments(named))})", ""]
        text = function_lines(function, names, self.syntax.element, shared, row_major=False, prose=MARKDOWN)
        # In a raw string nothing is interpolated, and no character of the text is a quote that ends it.
        lines += [*wrapped_lines(text, ""), '"""']
        typed = [f"{names[o.name]}::{_type(o.shape)}" for o in function.outputs]
        typed += [f"{names[a.name]}::AbstractVector{{Float64}}" for a in function.arguments]
        lines += [f"function {named.name}!(", *(f"    {text}," for text in typed), ")"]
        for output in function.outputs:
            name, size = names[output.name], self.sizes.of[function.name, output.name]
            if len(output.shape) == 1:
                lines.append(_check(f"length({name}) == {size}", f"{name} must have {output.size} elements"))
            elif output.shape:
                shape = f"({', '.join(map(str, output.shape))})"
                lines.append(_check(f"size({name}) == {shape}", f"{name} must have the size {shape}"))
        for argument in function.arguments:
            name, size = names[argument.name], self.sizes.of[function.name, argument.name]
            lines.append(_check(f"length({name}) == {size}", f"{name} must have {argument.width} elements"))
        arrays = [names[o.name] for o in function.outputs if o.shape] + named.argument_names
        lines += [f"    Base.require_one_based_indexing({', '.join(arrays)})"] if arrays else []
        lines.append("    @inbounds begin")
        lines += [f"        {a.name} = {a.expression}" for a in found.assignments]
        for output, listed in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            if listed.mostly_zero:
                lines.append(f"        {name} .= 0.0")
            places = indices_from_one(output.shape)
            lines += [f"        {name}[{places[k]}] = {text}" for k, text in listed.stored]
        return [*lines, "    end", "    return nothing", "end"]

    @staticmethod
    def _arguments(named: NamedFunction) -> list[str]:
        return [*named.output_names, *named.argument_names]

    def _test(self) -> str:
        lines = [
            f"# {marker(self.project.version)}",
            "# Compare the functions with reference values: julia --project test/runtests.jl",
            "",
            "using Test",
            f"using {self.module}",
            "",
            "# Elements row by row, as the reference values are.",
            "elements(x::Ref) = [x[]]",
            "elements(x::AbstractArray) = vec(permutedims(x, ndims(x):-1:1))",
            "agrees(x, y, tolerance) = length(x) == length(y) && all(abs.(x .- y) .<= tolerance)",
        ]
        for named in self.functions:
            reference = self.project.references[named.function.name]
            lines += ["", f'@testset "{named.name}!" begin']
            for sample in range(reference.samples):
                lines.append("    let")
                results, inputs = [], []
                for j, output in enumerate(named.function.outputs):
                    results.append(f"result_{j + 1}")
                    shape = ", ".join(map(str, output.shape))
                    lines.append(f"        result_{j + 1} = {f'fill(NaN, {shape})' if shape else 'Ref(NaN)'}")
                for j, array in enumerate(reference.inputs):
                    inputs.append(f"input_{j + 1}")
                    lines += _literal(f"input_{j + 1}", array[sample])
                lines.append(f"        {self.module}.{named.name}!({', '.join([*results, *inputs])})")
                for result, array, tolerance in zip(results, reference.outputs, reference.tolerances, strict=True):
                    lines += _literal("expected", array[sample])
                    lines.append(f"        @test agrees(elements({result}), expected, {number(tolerance)})")
                lines.append("    end")
            lines.append("end")
        return "\n".join(lines) + "\n"

    def _use(self) -> list[str]:
        named = self.functions[0]
        made = []
        for output in named.function.outputs:
            shape = ", ".join(map(str, output.shape))
            made.append(f"{named.names[output.name]} = {f'zeros({shape})' if shape else 'Ref(0.0)'}")
        return [
            "```julia",
            f"using {self.module}",
            "",
            *made,
            f"{named.name}!({', '.join(self._arguments(named))})",
            "```",
            "",
            "The functions allocate nothing. Outputs must not share memory with arguments. The self-test is",
            "`julia --project test/runtests.jl`, or `Pkg.test()`.",
        ]


write = _Source.write


def _type(shape: tuple[int, ...]) -> str:
    kinds = {0: "Ref{Float64}", 1: "AbstractVector{Float64}", 2: "AbstractMatrix{Float64}"}
    return kinds.get(len(shape), f"AbstractArray{{Float64,{len(shape)}}}")


def _check(condition: str, message: str) -> str:
    return f'    {condition} || throw(DimensionMismatch("{message}"))'


def _literal(name: str, values: NDArray[np.float64]) -> list[str]:
    if len(values) == 0:
        return [f"        {name} = Float64[]"]
    return [f"        {name} = [", *number_lines(values, " " * 12), "        ]"]
