"""Totals since the start, and powers of the last step for the trapezoidal rule; implicit: a row per body."""

from thirdbody.kernels.columns.table import Table

table = Table("A", "the run")

FRICTION_WORK = table.scalar("friction_work", "J", "dissipated by friction")
DAMPING_WORK = table.scalar("damping_work", "J", "dissipated by dashpots")
PLATE_WORK = table.scalar("plate_work", "J", "work of the plates")
PLATE_WORK_SIZE = table.scalar("plate_work_size", "J", "sum of the sizes of its increments")
EFFECT_WORK = table.scalar("effect_work", "J", "work of body effects")
UPPER_IMPULSE, UPPER_IMPULSE3 = table.vector("upper_impulse", 3, "N s", "impulse on the upper plate")
LOWER_IMPULSE, LOWER_IMPULSE3 = table.vector("lower_impulse", 3, "N s", "impulse on the lower plate")
TIME = table.scalar("time", "s", "time")
DISTANCE = table.scalar("distance", "m", "path of the upper plate relative to the lower one")
EFFECT_POWER = table.scalar("effect_power", "W", "power of body effects")
PATCH_POWER = table.scalar("patch_power", "W", "power of debris on the patches")
LOAD_POWER = table.scalar("load_power", "W", "power of the loads")
UPPER_FORCE, UPPER_FORCE3 = table.vector("upper_force", 3, "N", "force on the upper plate")
LOWER_FORCE, LOWER_FORCE3 = table.vector("lower_force", 3, "N", "force on the lower plate")
SHIFT_X = table.scalar("shift_x", "m", "displacement of the upper plate since the last observation, x")
SHIFT_Y = table.scalar("shift_y", "m", "the same, y")
STEPS = table.scalar("steps", "", "number of steps")
ELAPSED = table.scalar("elapsed", "s", "time since the last observation")
PLATE_SPEED = table.scalar("plate_speed", "m/s", "speed of the upper plate in the last step")
HEADING, HEADING2 = table.vector("heading", 2, "", "unit vector of the last relative motion of the plates")
NUMERICAL_LOSS = table.scalar("numerical_loss", "J", "what the integrator itself lost")
MAX_DISPLACEMENT = table.scalar("max_displacement", "m", "no body is farther from where the last search saw it")
STORED_NORMAL = table.scalar("stored_normal", "J", "energy of the normal springs of all contacts at the last observed step")
STORED_TANGENTIAL = table.scalar("stored_tangential", "J", "the same of the tangential and rolling springs")
DIRECT_WORK = table.scalar("direct_work", "J", "dissipated by friction of direct contact of the plates")
DIRECT_IMPULSE, DIRECT_IMPULSE3 = table.vector("direct_impulse", 3, "N s", "impulse of direct contact on the upper plate")
DIRECT_FORCE, DIRECT_FORCE3 = table.vector("direct_force", 3, "N", "force of direct contact on the upper plate")
WIDTH = table.width
