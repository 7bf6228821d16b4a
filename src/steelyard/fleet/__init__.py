"""Many logs and many robots, on processes of this machine or on a cluster."""

__all__: list[str] = []
