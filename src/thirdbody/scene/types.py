"""The named value types of the scene model: quantities in SI with their limits."""

from __future__ import annotations

from typing import Annotated

from thirdbody.scene.fields import FLAG, TEXT, Quantity, Whole, listing

Text = Annotated[str, TEXT]
Flag = Annotated[bool, FLAG]
MOST_SPHERES = 10_000_000
"""Spheres of a scene: about 10 GB of state and contacts. More is refused before anything is allocated."""

Count = Annotated[int, Whole(ge=1)]
Seed = Annotated[int, Whole(ge=0)]

Number = Annotated[float, Quantity()]
PositiveNumber = Annotated[float, Quantity(gt=0)]
Fraction = Annotated[float, Quantity(gt=0, le=1)]

Length = Annotated[float, Quantity(dimension="length")]
PositiveLength = Annotated[float, Quantity(dimension="length", gt=0)]
PositiveTime = Annotated[float, Quantity(dimension="time", gt=0)]
PositivePressure = Annotated[float, Quantity(dimension="pressure", gt=0)]
PositiveMass = Annotated[float, Quantity(dimension="mass", gt=0)]
PositiveForce = Annotated[float, Quantity(dimension="force", gt=0)]
Force = Annotated[float, Quantity(dimension="force", ge=0)]
PositiveStiffness = Annotated[float, Quantity(dimension="stiffness", gt=0)]
PositiveFrequency = Annotated[float, Quantity(dimension="frequency", gt=0)]
PositiveDensity = Annotated[float, Quantity(dimension="density", gt=0)]
Damping = Annotated[float, Quantity(dimension="damping", ge=0)]
Speed = Annotated[float, Quantity(dimension="velocity")]
Spin = Annotated[float, Quantity(dimension="angular_velocity")]
Acceleration = Annotated[float, Quantity(dimension="acceleration")]

THREE = listing("a list of 3 values", 3)
Point = Annotated[tuple[Length, Length, Length], THREE]
Velocity = Annotated[tuple[Speed, Speed, Speed], THREE]
AngularVelocity = Annotated[tuple[Spin, Spin, Spin], THREE]
AccelerationVector = Annotated[tuple[Acceleration, Acceleration, Acceleration], THREE]
REST = (0.0, 0.0, 0.0)
