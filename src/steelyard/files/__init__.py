"""Files: reading that is bounded, and writing that leaves a file or a folder whole or as it was."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .advance import tell as tell
    from .advance import watched as watched
    from .arguments import is_number as is_number
    from .arguments import is_real as is_real
    from .arguments import listed as listed
    from .arguments import read_number as read_number
    from .arguments import read_whole as read_whole
    from .arguments import suggestion as suggestion
    from .meanwhile import Meanwhile as Meanwhile
    from .meanwhile import without_warnings as without_warnings
    from .reading import LARGEST_JSON as LARGEST_JSON
    from .reading import LARGEST_TEXT as LARGEST_TEXT
    from .reading import file_hash as file_hash
    from .reading import parse_json as parse_json
    from .reading import read_bytes as read_bytes
    from .reading import read_json as read_json
    from .reading import read_text as read_text
    from .reading import read_toml as read_toml
    from .reading import reading_table as reading_table
    from .reading import require_file as require_file
    from .reading import require_format as require_format
    from .reading import shown as shown
    from .table_files import check_parquet as check_parquet
    from .table_files import read_table as read_table
    from .table_files import write_table as write_table
    from .toml_table import TomlSection as TomlSection
    from .toml_table import TomlTable as TomlTable
    from .toml_table import made_from_table as made_from_table
    from .writing import plain as plain
    from .writing import replaced_file as replaced_file
    from .writing import replaced_folder as replaced_folder
    from .writing import write_bytes as write_bytes
    from .writing import write_json as write_json
    from .writing import write_text as write_text

__all__ = import_at_first_use(__name__, __file__)
