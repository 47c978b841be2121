"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.sampling import ELSEWHERE as ELSEWHERE
from thirdbody.trajectory.sampling import sample_of as sample_of
