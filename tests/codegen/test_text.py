"""Names, descriptions and numbers become harmless text and keep what is plain."""

import re
import unicodedata

import pytest
from any_text import CHARACTERS
from hypothesis import example, given
from hypothesis import strategies as st

from steelyard.codegen import Names
from steelyard.codegen.text import comment_lines, comment_text, identifier, markdown_text, number, number_lines

OPENERS = ("*/", "/*", "??", "%{", "%}", "#{", "#}", "#=", "=#", "-->", "<!--", '""', "''", "``", ">>", "]]", "]=")
SPECIAL = "\\*/?%#=-<>\"'`]{} "


@given(st.text(CHARACTERS))
@example("*/*/ ??/\n\\ %{ #= =# --> \u202e\u2066 \x00\x1b[2J \ud800 \u2028\r\n")
@example("//*//**/ ???/ ''''''' \"\"\"\"\"\" <!--->")
def test_nothing_opens_closes_or_continues_a_comment(text: str) -> None:
    plain = comment_text(text)
    assert [opener for opener in OPENERS if opener in plain] == []
    assert "\\" not in plain
    categories = {unicodedata.category(character)[0] for character in plain.replace("\N{REPLACEMENT CHARACTER}", "")}
    assert "C" not in categories
    assert [character for character in plain if character.isspace() and character != " "] == []
    assert plain.encode().decode() == plain  # no lone surrogates
    assert comment_text(plain) == plain


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters=SPECIAL), min_size=1))
def test_plain_text_stays(text: str) -> None:
    assert comment_text(text) == text


def test_units_and_foreign_letters_stay() -> None:
    text = "Lyy2: N·m·s/rad, kg·m², «Gelenk für Ölpumpe», 関節, угол φ, 50 % at https://example.org/a?b=c"
    assert comment_text(text) == text


@given(st.lists(st.text(CHARACTERS), max_size=5), st.sampled_from(["// ", " * ", "# ", "% ", "//! "]))
def test_every_line_is_a_comment_of_bounded_width(lines: list[str], prefix: str) -> None:
    for line in comment_lines(lines, prefix):
        assert line.startswith(prefix.rstrip())
        assert line == line.rstrip()
        assert len(line.splitlines()) == 1
        assert "*/" not in line
    assert len(comment_lines(["word " * 100], prefix)) >= 5
    assert all(len(line) <= 100 for line in comment_lines(["word " * 100], prefix))


@given(st.text(CHARACTERS))
@example("<script>alert(1)</script> [x](javascript:y) `code` | $z$ #1")
def test_markdown_has_no_markup(text: str) -> None:
    plain = markdown_text(text)
    assert "<" not in plain
    assert re.search(r"(?<!\\)[`*_\[\]|~$]", plain) is None


@given(st.text(CHARACTERS))
@example("")
@example("7")
@example("_")
@example("int main(){}")
def test_any_text_gives_an_identifier(text: str) -> None:
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", identifier(text))


@given(st.lists(st.sampled_from(["int", "int_", "int_2", "q", "Q", "q_2", "t1"])), st.booleans())
def test_names_differ(wanted: list[str], ignore_case: bool) -> None:
    names = Names({"int", "t1"}, ignore_case=ignore_case)
    taken = [names.take(name) for name in wanted]
    keys = [name.lower() for name in taken] if ignore_case else taken
    assert len(set(keys)) == len(taken)
    assert not {"int", "t1"} & set(keys)
    prefix = names.prefix("t")
    assert [name for name in ("t1", *taken) if re.fullmatch(re.escape(prefix) + r"\d+", name)] == []


def test_inner_scope_leaves_the_outer_one_alone() -> None:
    outer = Names({"if"})
    outer.take("q")
    inner = outer.inner()
    assert [inner.take(name) for name in ("q", "x", "if")] == ["q_2", "x", "if_"]
    assert outer.take("x") == "x"


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_read_back_exactly(value: float) -> None:
    text = number(value)
    assert float(text) == value
    assert re.search(r"[.e]", text)


@pytest.mark.parametrize("count", [0, 1, 5, 200])
def test_number_lines_hold_all_the_numbers(count: int) -> None:
    values = [0.1 * k - 3.0 for k in range(count)]
    lines = number_lines(values, "    ")
    assert [float(part) for part in " ".join(lines).split(",") if part.strip()] == values
    assert all(len(line) <= 100 and line.startswith("    ") for line in lines)
