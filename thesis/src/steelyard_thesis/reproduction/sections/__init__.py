"""The sections, one file each, with a `SECTION`."""

__all__: list[str] = []
