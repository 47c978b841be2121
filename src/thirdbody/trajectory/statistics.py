"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.friction import mean_and_error as mean_and_error
from thirdbody.trajectory.friction import running_mean as running_mean
