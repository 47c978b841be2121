"""State of the implicit integrator per body, in addition to its totals (a row like `run_totals`)."""

from thirdbody.kernels.columns.table import Table

table = Table("T", "a body")

NEXT_DT = table.scalar("next_dt", "s", "length of the step to try next")
CUTS = table.scalar("cuts", "", "number of steps that were cut")
HARD_STEPS = table.scalar("hard_steps", "", "number of steps that were cut often")
TRIES = table.scalar("tries", "", "number of steps tried")
ITERATIONS = table.scalar("iterations", "", "number of iterations of Newton's method")
STORED = table.scalar("stored", "J", "elastic energy of its contacts")
CONTACT_RADIUS = table.scalar("contact_radius", "m", "radius of its largest contact")
CODE = table.scalar("code", "", "what stopped the body (`implicit.step_control.Stop`)")
SLOT = table.scalar("slot", "", "the contact that stopped it")
LONGEST_DRAG = table.scalar("longest_drag", "m", "longest drag of a step")
LAST_DT = table.scalar("last_dt", "s", "length of the last step; 0: start anew")
JUMPED = table.scalar("jumped", "", "1: forces jumped in the last step, which started anew")
LAST_COORDINATES, LAST_COORDINATES7 = table.vector("last_coordinates", 7, "m", "coordinates of the last step")
LAST_DV, LAST_DV3 = table.vector("last_dv", 3, "m/s", "change of the velocity in the last step")
LAST_DL, LAST_DL3 = table.vector("last_dl", 3, "kg m2/s", "change of the angular momentum in it")
LAST_DW, LAST_DW3 = table.vector("last_dw", 3, "rad/s", "change of the angular velocity in it")
LAST_DRISE = table.scalar("last_drise", "m/s", "change of the velocity of the patch in it")
STIFFNESS = table.scalar("stiffness", "N/m", "stiffness of the body")
LIMIT = table.scalar("limit", "", "what limits the length of the next step (`implicit.step_limits.StepLimit`)")
LIMITED, LIMITED8 = table.vector("limited", 8, "", "how many steps each cause has limited")
MAX_ENERGY = table.scalar("max_energy", "J", "largest energy that its contacts could store so far (`friction_work`)")
CANDIDATES = table.scalar("candidates", "", "number of candidates that can touch in this step: the first ones of the body")
LAST_FORCE, LAST_FORCE2 = table.vector(
    "last_force", 2, "N", "rough plates: change of the force on the upper plate along x and y in the last step"
)
WIDTH = table.width
