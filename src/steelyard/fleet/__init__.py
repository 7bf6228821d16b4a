"""Many logs and many robots, on processes of this machine or on a cluster."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .checkpoints import Checkpoints as Checkpoints
    from .checkpoints import checkpoint_key as checkpoint_key
    from .data_sets import DataSet as DataSet
    from .data_sets import ReducedDataSet as ReducedDataSet
    from .data_sets import reduce_data_sets as reduce_data_sets
    from .executors import Cluster as Cluster
    from .executors import Executor as Executor
    from .executors import Here as Here
    from .executors import Workers as Workers
    from .log_reduction import LogReduction as LogReduction

__all__ = import_at_first_use(__name__, __file__)
