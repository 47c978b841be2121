"""State, time integration, time step, energy and guards. Knows contacts, bodies and plates; no third-body theory."""
