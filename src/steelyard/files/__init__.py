"""Files: reading that is bounded, and writing that leaves a file or a folder whole or as it was."""

from .folder import replaced_folder
from .reading import (
    LARGEST_JSON,
    LARGEST_TEXT,
    parse_json,
    read_bytes,
    read_json,
    read_text,
    read_toml,
    require_file,
    shown,
)
from .tables import reading_table
from .writing import replaced_file, write_bytes, write_json, write_text

__all__ = [
    "LARGEST_JSON",
    "LARGEST_TEXT",
    "parse_json",
    "read_bytes",
    "read_json",
    "read_text",
    "read_toml",
    "reading_table",
    "replaced_file",
    "replaced_folder",
    "require_file",
    "shown",
    "write_bytes",
    "write_json",
    "write_text",
]
