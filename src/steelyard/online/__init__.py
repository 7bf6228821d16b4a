"""What runs while the robot moves."""

__all__: list[str] = []
