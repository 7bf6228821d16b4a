"""Regression: Information, weights, least squares, the covariance of the parameters, and estimates."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .estimate import Estimate as Estimate
    from .factor import Factor as Factor
    from .factor import Reduced as Reduced
    from .factor import column_lengths as column_lengths
    from .factor import triangular as triangular
    from .information import Information as Information
    from .least_squares import least_squares as least_squares
    from .least_squares import method_name as method_name
    from .parameter_covariance import ParameterCovariance as ParameterCovariance
    from .parameter_covariance import ResidualCorrelation as ResidualCorrelation
    from .residual_covariance import residual_covariance as residual_covariance
    from .torque_gains import torque_gains as torque_gains

__all__ = import_at_first_use(__name__, __file__)
