"""Which column of which table holds what. Every kernel, the engine and the labellers read these names.

Tables are C-contiguous float64 with one row per thing, so that a kernel touches one cache line where it can.
"""

# S: spheres, in groups of four columns. Mid-step velocities carry the displacement of the step; the synchronised ones feed the
# dashpots. What B has too, it has in the same columns: where all bodies are spheres round their centres of mass, both
# are one table.
S_X, S_Y, S_Z, S_R = 0, 1, 2, 3
S_U = 4  # mid-step velocity of the centre, 3
S_MASS = 7  # of its body
S_W = 8  # mid-step angular velocity, 3
S_V = 12  # velocity predicted for the end of the step, 3
S_SIDE = 15  # what the sphere can meet
S_O = 16  # angular velocity predicted for the end of the step, 3
S_ARM = 20  # centre of the sphere from its body's centre of mass, world axes, 3: columns that a table of its own has
S_COLS = 24

# X0: where a body was at the last search (position, 3; quaternion, 4).
X_X, X_Q = 0, 3
X_COLS = 7

# B: bodies, in groups of four columns: four lines of the cache, all that a step reads and writes of a ball.
B_X = 0  # position, 3
B_V = 4  # velocity: full step when synchronised, mid-step inside a step, 3
B_MASS = 7
B_W = 8  # angular velocity, 3: of a ball as the velocity, of other bodies synchronised where somebody looks
B_BALL = 11  # moment of inertia of a ball; 0: not a ball
B_F = 20  # total force, 3
B_WORK = 23  # friction work, J, cumulative; behind the force, so that it is summed with it
B_T = 24  # total torque, 3
B_SLIP = 27  # slip distance, m, cumulative: the sum over the body's spots; behind the torque
B_Q = 28  # quaternion w, x, y, z; body to world, 4
B_COLS = 32

# E: bodies, what a ball needs in few steps only: a line of the cache.
E_L = 0  # angular momentum, world axes, 3: as the velocity, but of a ball where somebody looks
E_ARM = 3  # how far its farthest sphere is from its centre
E_I = 4  # principal moments, 3
E_PUSH = 7  # force of the upper plate on the body, upwards; a patch feels it
E_EF = 8  # force of body effects, 3: columns that only a scene with body effects has
E_ET = 12  # torque of body effects, 3
E_COLS = 16

# P: patches of the upper body (one for a rigid plate, else one per body); on a foundation the last row is the common plate.
# P_SPRING is the stiffness of a patch's spring to that plate; P_F is the force of debris and springs, upwards.
# P_LOAD0 is the load of which a schedule of loads gives the factor.
P_Z, P_V, P_MASS, P_DAMPING, P_LOAD, P_F, P_FREE, P_Z0, P_SPRING, P_LOAD0 = range(10)
P_COLS = 10

# H: what a candidate contact remembers: an axis of its frame (3), whether it touches, the history of the laws from H_LAW on (in
# four columns or more), then the memory of the labeller. Most chains of laws remember four numbers: a line of the cache.
H_E, H_ON, H_LAW = 0, 3, 4
H_SLIP = H_ON  # 0 where it is open; else its slip since it closed, m, and H_LEAST or more
H_LEAST = 1e-300
H_COLS = 8  # at least

# F: what contacts between bodies of two groups did to their partners in this step, zero where they do not touch: force and torque
# on the partner's body, 3 each, and behind them its shares of friction work and slip.
F_F, F_T = 0, 4
F_COLS = 8

# R: full record of a contact, written in observed steps; it has no rows where nobody is going to read them.
R_POINT = 0  # contact point minus centre of the owner's body, 3
R_POINT_J = 3  # contact point minus centre of the partner's body, 3
R_N = 6  # unit normal from partner to owner, 3
R_CURVATURE, R_CURVATURE_J = 9, 10
R_A, R_OVERLAP, R_FN, R_LOAD = 11, 12, 13, 14
R_T = 15  # tangential force on the owner, 3
R_LIMIT, R_CRITICAL = 18, 19
R_VI = 20  # velocity of the owner's surface at the contact, 3
R_VJ = 23  # velocity of the partner's surface at the contact, 3
R_STORED_N, R_STORED_T = 26, 27
R_EFFECTIVE = 28
R_COLS = 30
R_M, R_M_LIMIT = 30, 33  # moment on the owner, 3, and its limit: columns that only a scene with a rolling law has
R_ROLLING_COLS = 34

# Law tile: input fields (then history), output fields (then history); stride TILE.
TILE = 64
I_OVERLAP, I_RADIUS, I_MASS, I_VN, I_SX, I_SY, I_VX, I_VY, I_TYPE, I_HISTORY = range(10)
(O_FN, O_TX, O_TY, O_LOAD, O_LIMIT, O_CRITICAL, O_SLIP, O_A, O_STORED_N, O_STORED_T, O_WORK, O_LOST, O_POWER,
 O_HISTORY) = range(14)  # fmt: skip
# O_WORK: all that laws dissipate in the step; O_LOST: the part of it that is friction's, of tangential and rolling laws.
# O_POWER: power of the dashpots at the end of the step, W; in explicit steps then what they take in it, J (`booking`).
# Behind the history, only if a law asks for it: relative rotation of the step and its rate, travel of the patch; the moment, and
# forces and moment of the dashpots.
# J_INVERSE, for tangents: one over the length of the step, 0 where nothing moves in time.
J_X, J_Y, J_RATE_X, J_RATE_Y, J_TRAVEL_X, J_TRAVEL_Y, J_INVERSE, J_COLS = range(8)
Q_X, Q_Y, Q_LIMIT, Q_VISCOUS_N, Q_VISCOUS_X, Q_VISCOUS_Y, Q_VISCOUS_MX, Q_VISCOUS_MY, Q_COLS = range(9)

# G: geometry of the contacts of a tile; stride TILE like the law's own tables.
G_N, G_P = 0, 3  # unit normal from partner to owner; that of the middle of the step
G_E, G_D = 6, 9  # axes of the contact's frame: the carried one, and normal times it
G_ARM_I, G_ARM_J = 12, 13  # from the centres to the contact point
G_U, G_W, G_RW = 14, 17, 20  # of the step: relative velocity of the centres; sum of the spins; the same, each times its radius
G_V, G_O, G_RO = 23, 26, 29  # the same at the end of the step
G_ON, G_RI, G_RJ, G_MJ = 32, 33, 34, 35  # whether it touched before; radii; mass of the partner's body
G_F, G_TI, G_TJ = 14, 17, 20  # then, in place of what is needed no more: force on the owner, torques about the two centres
G_COLS = 36

# A: totals since the start of the run (J, N s, m), and the powers of the last step for the trapezoid.
A_FRICTION, A_DAMPING, A_PLATE_WORK, A_PLATE_ABS, A_EFFECTS = range(5)
A_IMPULSE, A_IMPULSE_LOW = 5, 8  # of the upper and of the lower plate, 3 each
A_TIME, A_DISTANCE = 11, 12
A_POWER_EFFECTS, A_POWER_PATCH, A_POWER_LOAD = 13, 14, 15
A_UPPER, A_LOWER = 16, 19  # forces on the plates, 3 each
A_DX, A_DY, A_STEPS, A_ELAPSED, A_SPEED = 22, 23, 24, 25, 26
A_HEADING = 27  # unit vector of the last relative motion of the plates, 2
A_NUMERICAL = 29  # what the integrator itself lost
A_FAR = 30  # no body is farther from where the last search saw it
A_STORED_N, A_STORED_T = 31, 32  # elastic energy of all contacts at the last observed step
A_COLS = 33

# K: tangents of a contact (N/m): dN/dd, dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd; then, only with a law of the rolling
# stage, the same six of its moment and turn.
K_NORMAL, K_XX, K_XY, K_YX, K_YY, K_XD, K_YD, K_ROLL = range(8)
K_COLS, K_ROLLING_COLS = 7, 13

# D: the periodic lengths (0 = unbounded, negative = walls), limits of guards and search.
D_LX, D_LY, D_GUARD_OVERLAP, D_GUARD_TRAVEL, D_SKIN, D_FLOOR = range(6)
D_COLS = 6

# C: one row per loaded contact of a body, handed to a labeller; its own memory follows from C_MEMORY on.
C_PARTNER, C_POINT, C_NORMAL, C_CURVATURE, C_A, C_OVERLAP, C_FN, C_LOAD = 0, 1, 4, 7, 8, 9, 10, 11
C_T, C_LIMIT, C_CRITICAL, C_SLIP, C_V, C_IDENTITY, C_MEMORY = 12, 15, 16, 17, 18, 21, 22

# O: the body and its surroundings, handed to a labeller.
O_MASS, O_X, O_V, O_Q, O_W, O_F, O_T, O_MA, O_LDOT, O_EF, O_ET = 0, 1, 4, 7, 11, 14, 17, 20, 23, 26, 29
O_ELAPSED, O_SHIFT, O_DRAG, O_SPEED = 32, 33, 35, 37
O_COLS = 38

LOWER, UPPER, DEBRIS = 0, 1, 2

# values of S_SIDE: a spot of a given particle meets one plate only
ONLY_LOWER, EVERYTHING, ONLY_UPPER = -1, 0, 1

# T: what the implicit integrator keeps per body beside its totals (a row like A): the length of the step to try next, counts,
# the elastic energy, the radius of the largest contact, what stopped the body; and of the last step, its length (0: start anew),
# coordinates (7), and changes of velocity (3), angular momentum (3), angular velocity (3) and of the velocity of the patch.
# T_WAY: longest way that a point of the body can have gone since the start. T_FIRM: its stiffness, N/m.
# T_LIMIT: what limits the length of the next step (`limits`); T_LIMITED: how many steps each cause has limited.
# T_ENERGY: most that its spots could hold so far (`friction_work`), J.
(T_DT, T_CUTS, T_HARD, T_TRIES, T_ITERATIONS, T_STORED, T_RADIUS, T_CODE, T_SLOT, T_LONGEST) = range(10)
T_LAST, T_Y, T_DV, T_DL, T_DW, T_DRISE, T_WAY, T_FIRM = 10, 11, 18, 21, 24, 27, 28, 29
T_LIMIT, T_LIMITED = 30, 31
T_ENERGY = 39
T_COLS = 40
