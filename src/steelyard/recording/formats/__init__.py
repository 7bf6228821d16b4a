"""Formats of log files, one a file, and the table in which they stand."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .hashes import content_hash as content_hash
    from .hashes import content_hashes as content_hashes
    from .hashes import contents_of as contents_of
    from .hashes import hashed_log as hashed_log
    from .hashes import unchanged as unchanged
    from .log_file import BLOCK_ROWS as BLOCK_ROWS
    from .log_file import Columns as Columns
    from .log_file import LogFile as LogFile
    from .log_file import flattened as flattened
    from .registry import LogFiles as LogFiles
    from .registry import Source as Source
    from .registry import require_unwritten as require_unwritten
    from .registry import write_log as write_log
    from .registry import written_states as written_states

__all__ = import_at_first_use(__name__, __file__)
