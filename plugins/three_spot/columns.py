"""Where each number of a body and of its loaded contacts stands in the flat tables that a labeller receives.

Contact table `C` (n, CONTACT_COLUMNS + labeller's own): one row per loaded contact of the body.
Body row `b` (BODY_COLUMNS,). SI units, world axes, forces and velocities as they act on or move past the body.
"""

from __future__ import annotations

# PARTNER takes one of these
LOWER_PLATE, UPPER_PLATE, DEBRIS = 0, 1, 2

# contact table
PARTNER = 0
PX, PY, PZ = 1, 2, 3  # contact point relative to the body's centre of mass, m
NX, NY, NZ = 4, 5, 6  # unit normal from the partner to the body
CURVATURE_RADIUS = 7  # m
CONTACT_RADIUS = 8  # m
OVERLAP = 9  # m
NORMAL_FORCE = 10  # N, total
LOAD = 11  # N, what friction may use
TX, TY, TZ = 12, 13, 14  # tangential force on the body, N
LIMIT = 15  # mu N, N
CRITICAL = 16  # displacement at which the whole contact slides, m
SLIP = 17  # length slipped since the contact began, m
VX, VY, VZ = 18, 19, 20  # the partner's surface at the contact, m/s
IDENTITY = 21  # unique to the pair, constant while the contact lives
CONTACT_COLUMNS = 22

# body row
MASS = 0  # kg
POSITION = 1  # 3, m
VELOCITY = 4  # 3, m/s
ORIENTATION = 7  # 4, quaternion (w, x, y, z), body to world
SPIN = 11  # 3, rad/s
FORCE = 14  # 3, N, contacts and body effects
TORQUE = 17  # 3, N m, about the centre of mass
MOMENTUM_RATE = 20  # 3, N, mass times acceleration
SPIN_MOMENTUM_RATE = 23  # 3, N m, rate of change of angular momentum
EFFECT_FORCE = 26  # 3, N, body effects alone
EFFECT_TORQUE = 29  # 3, N m
ELAPSED = 32  # s, since the last observation
DRAG_STEP = 33  # 2, m, upper plate relative to the lower since the last observation
DRAG_DIRECTION = 35  # 2, unit vector, last (or planned) relative motion of the plates; zero if they never move
DRAG_SPEED = 37  # m/s, relative motion of the plates now
BODY_COLUMNS = 38
