"""Any text, as `st.text()` draws it, which first encodes every character of Unicode in each new process: 2 s."""

from hypothesis import strategies as st

CHARACTERS = st.characters(exclude_categories=["Cs"])  # all but surrogates, which UTF-8 cannot hold
