"""The active observer: a Kalman filter that estimates state and disturbance of a controlled plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import positive, read_whole

__all__ = ["ActiveObserver"]

Array = NDArray[np.float64]


class ActiveObserver:
    """Estimates state and input disturbance of ``x[k] = F x[k-1] + s G (u[k-1] + p[k-1])``, ``y[k] = H x[k]``.

    The active observer of Cortesão, Park and Khatib (2006, IEEE Transactions on Robotics 22(5), 987 to 999; thesis
    section 2.4.4). The state is augmented by the disturbance p, whose difference of order `order` is white noise. The
    prediction uses the command that really acted. With state feedback that subtracts the estimated disturbance,
    ``u = reference - L x - p``, it is the prediction of the closed loop, ``(F - s G L) x + s G reference``; where a
    command was limited, the estimate does not diverge. The scale s of the input may change from call to call, as the
    stiffness of an environment does, and the Kalman gain adapts to it.

    Parameters
    ----------
    transition : array_like
        (n, n) transition matrix F.
    control : array_like
        (n,) input vector G.
    output : array_like
        (n,) output vector H.
    measurement_noise : float
        Standard deviation of the measured output y.
    disturbance_noise : float
        Standard deviation of the white noise that drives the disturbance in each call, in the unit of u.
    state_noise : array_like
        (n,) standard deviations of the white noise that drives the state in each call.
    order : int
        Order of the disturbance model: 1 for a random walk, 2 for a ramp with a random slope, and so on.

    Attributes
    ----------
    innovation : ndarray
        (...,) difference of the last measurement from its prediction.

    References
    ----------
    R. Cortesão, J. Park and O. Khatib, Real-time adaptive control for haptic telemanipulation with Kalman active
    observers, IEEE Transactions on Robotics 22(5), 2006.

    Examples
    --------
    >>> observer = ActiveObserver([[1.0]], [0.1], [1.0], measurement_noise=0.1, disturbance_noise=0.1)
    >>> observer.start(np.array(0.0))
    >>> place = 0.0
    >>> for _ in range(300):  # a mass that an unknown 2.0 pushes
    ...     place += 0.1 * 2.0
    ...     state, disturbance = observer.update(np.array(place), np.array(0.0))
    >>> round(float(disturbance), 3)
    2.0
    """

    def __init__(
        self,
        transition: ArrayLike,
        control: ArrayLike,
        output: ArrayLike,
        *,
        measurement_noise: float,
        disturbance_noise: float,
        state_noise: ArrayLike = 0.0,
        order: int = 1,
    ) -> None:
        F, G, H = (np.array(a, dtype=np.float64) for a in (transition, control, output))
        n = G.size
        if F.shape != (n, n) or G.shape != (n,) or H.shape != (n,) or n == 0:
            raise InputError(
                f"An active observer needs matrices of shapes (n, n), (n,) and (n,), got {F.shape}, {G.shape} and "
                f"{H.shape}."
            )
        self.order = order = read_whole(order, "order", 1)
        self.size = n
        size = n + order
        self._control = np.concatenate((G, np.zeros(order)))
        self._fixed = np.zeros((size, size))  # the transition without the control
        self._fixed[:n, :n] = F
        self._fixed[n:, n:] = np.eye(order) + np.eye(order, k=1)
        self._push = np.outer(self._control, np.eye(size)[n])  # how the disturbance acts on the state
        self._output = np.concatenate((H, np.zeros(order)))
        self._measured = positive(measurement_noise, "measurement_noise", "1") ** 2
        driven = positive(disturbance_noise, "disturbance_noise", "1") ** 2
        spread = np.broadcast_to(np.asarray(state_noise, dtype=np.float64), (n,)) ** 2
        self._driven = np.diag(np.concatenate((spread, np.zeros(order - 1), [driven])))
        # The initial disturbance may be as large as 100 steps of its random walk make it: ten times the noise.
        self._begin = np.diag(np.concatenate((np.full(n, self._measured), np.full(order, 100.0 * driven))))
        self.innovation = np.zeros(())
        self._x = np.zeros(size)
        self._covariance = self._begin

    @property
    def state(self) -> Array:
        """The estimated state (..., n)."""
        return self._x[..., : self.size]

    @property
    def disturbance(self) -> Array:
        """The estimated disturbance (...,), in the unit of the command."""
        return self._x[..., self.size]

    def start(
        self,
        output: Array,
        state: Array | None = None,
        disturbance: Array | float = 0.0,
        where: NDArray[np.bool_] | bool = True,
    ) -> None:
        """Restart the estimate.

        Parameters
        ----------
        output : ndarray
            (...,) the measured output.
        state : ndarray, optional
            (..., n) initial state; by default the smallest state with this output.
        disturbance : ndarray or float
            (...,) initial disturbance.
        where : ndarray or bool
            (...,) the runs that are restarted.
        """
        fresh = np.zeros((*output.shape, self.size + self.order))
        if state is None:
            H = self._output[: self.size]
            fresh[..., : self.size] = output[..., None] * H / (H @ H)
        else:
            fresh[..., : self.size] = state
        fresh[..., self.size] = disturbance
        if where is True or self._x.shape != fresh.shape:
            self._x = fresh
            self._covariance = np.array(np.broadcast_to(self._begin, (*output.shape, *self._begin.shape)))
            return
        chosen = np.asarray(where)
        self._x = np.where(chosen[..., None], fresh, self._x)
        self._covariance = np.where(chosen[..., None, None], self._begin, self._covariance)

    def update(self, output: Array, command: Array, scale: Array | float = 1.0) -> tuple[Array, Array]:
        """Update the estimate with a measurement.

        Parameters
        ----------
        output : ndarray
            (...,) the output that is measured now.
        command : ndarray
            (...,) the input that acted since the last call.
        scale : ndarray or float
            (...,) scale s of the input.

        Returns
        -------
        state, disturbance : ndarray
            (..., n) and (...,).
        """
        scale = np.asarray(scale, dtype=np.float64)
        transition = self._fixed + scale[..., None, None] * self._push
        x = (transition @ self._x[..., None])[..., 0] + (scale * command)[..., None] * self._control
        covariance = transition @ self._covariance @ np.swapaxes(transition, -1, -2) + self._driven
        column = covariance @ self._output
        gain = column / (column @ self._output + self._measured)[..., None]
        self.innovation = np.asarray(output - x @ self._output)
        self._x = x + gain * self.innovation[..., None]
        covariance = covariance - gain[..., :, None] * column[..., None, :]
        self._covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
        return self.state, self.disturbance
