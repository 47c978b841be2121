"""Former name of what it imports; goes once no file uses it."""

from thirdbody.trajectory.states import POPULATION as POPULATION
from thirdbody.trajectory.states import code_name as code_name
from thirdbody.trajectory.states import fractions_text as fractions_text
from thirdbody.trajectory.states import informative_groups as informative_groups
from thirdbody.trajectory.states import states_by_group as states_by_group
