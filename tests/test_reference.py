"""The reference describes every public name once, and shows it in use; names in the documentation lead to it."""

import re
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest
from python_file import module_of_file

DOCS = Path(__file__).resolve().parent.parent / "docs"


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    return module_of_file(DOCS / "hooks.py")


def ours(hooks: ModuleType) -> list[str]:
    return [name for name in hooks.entries() if name.startswith("steelyard.")]


def test_every_public_name_is_described_once(hooks: ModuleType) -> None:
    text = "\n".join(hooks.pages().values())
    twice = [name for name, count in Counter(re.findall(r"^::: (\S+)$", text, re.MULTILINE)).items() if count > 1]
    assert twice == []
    described = Counter(id(hooks.described(name)) for name in ours(hooks))
    public = hooks.public_names()
    assert len(public) > 300
    assert [name for name, value in public.items() if described[id(value)] == 0] == []
    assert [name for name in ours(hooks) if described[id(hooks.described(name))] > 1] == []


def test_every_name_of_the_reference_has_an_example(hooks: ModuleType) -> None:
    lacking = [
        name for name in ours(hooks) if not hooks.own_example(hooks.described(name)) and hooks.uses(name) == ([], [])
    ]
    assert lacking == []


def test_each_equation_leads_to_a_function_that_is_there(hooks: ModuleType) -> None:
    """Every name of code on the page of equations is described in the reference, or is a member of what is."""
    page = (DOCS / "thesis" / "equations.md").read_text(encoding="utf-8")
    rows = [line.rsplit("|", 2)[1] for line in page.splitlines() if re.match(r"\| (tables? )?\d\.", line)]
    assert len(rows) > 45
    names = {name for row in rows for name in re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", row)}
    unknown = []
    for name in names - {"margin", "sign_width", "METHODS"}:  # arguments, and a table of the other package
        short, _, member = re.sub(r"^(sy|steelyard)\.([a-z_]+\.(?=[A-Za-z]))?", "", name).partition(".")
        target = hooks._by_short_name().get(short)
        if target is None:
            if not any(hasattr(hooks.described("steelyard.dynamics.Model"), part) for part in (name, short)):
                unknown.append(name)
        elif target.startswith("steelyard.") and member:
            value = hooks.described(target)
            if not (hasattr(value, member) or member in getattr(value, "__annotations__", {})):
                unknown.append(name)
    assert unknown == []


def test_names_become_links_and_words_do_not(hooks: ModuleType) -> None:
    link = '<autoref identifier="{}">{}</autoref>'.format
    turned = {
        "<code>sy.fit</code>": link("steelyard.estimators.fit", "<code>sy.fit</code>"),
        "<code>FeasibleSet</code>": link("steelyard.feasibility.FeasibleSet", "<code>FeasibleSet</code>"),
        "<code>fit</code>": "<code>fit</code>",  # may be a command
        "<pre><code>FeasibleSet</code></pre>": "<pre><code>FeasibleSet</code></pre>",
        '<h2 id="a"><code>FeasibleSet</code></h2>': '<h2 id="a"><code>FeasibleSet</code></h2>',
        "<code>unheard_of</code>": "<code>unheard_of</code>",
    }
    for before, after in turned.items():
        assert hooks.on_page_content(before, None) == after


def test_formulas_become_mathml(hooks: ModuleType) -> None:
    pytest.importorskip("latex2mathml", reason="latex2mathml (extra `docs`) is not installed")
    made = hooks.on_page_content(r'<p><span class="arithmatex">\(a &lt; \beta\)</span></p>', None)
    assert made.startswith("<p><math ")
    assert "&lt;" in made or "&#x0003C;" in made
    assert "\\" not in made
