"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.sampling import IntervalMeans as IntervalMeans
from thirdbody.trajectory.sampling import Sampler as Sampler
from thirdbody.trajectory.sampling import body_velocities as body_velocities
