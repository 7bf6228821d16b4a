"""Many logs and many robots, on processes of this machine or on a cluster."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .causes import Cause as Cause
    from .causes import gains_in_own_motion as gains_in_own_motion
    from .causes import possible_causes as possible_causes
    from .causes import variations as variations
    from .checkpoints import Checkpoints as Checkpoints
    from .checkpoints import checkpoint_key as checkpoint_key
    from .data_sets import DataSet as DataSet
    from .data_sets import ReducedDataSet as ReducedDataSet
    from .data_sets import reduce_data_sets as reduce_data_sets
    from .executors import Cluster as Cluster
    from .executors import Executor as Executor
    from .executors import Here as Here
    from .executors import Workers as Workers
    from .fleet import Finding as Finding
    from .fleet import Fleet as Fleet
    from .fleet import RobotGroup as RobotGroup
    from .fleet import RobotRow as RobotRow
    from .fleet import identify_fleet as identify_fleet
    from .log_reduction import LogReduction as LogReduction
    from .manifest import FleetEntry as FleetEntry
    from .manifest import FleetManifest as FleetManifest
    from .siblings import Batch as Batch
    from .siblings import Deviation as Deviation
    from .siblings import SiblingComparison as SiblingComparison
    from .siblings import compare_siblings as compare_siblings

__all__ = import_at_first_use(__name__, __file__)
