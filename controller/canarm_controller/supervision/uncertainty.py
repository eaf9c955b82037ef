"""How far a whole robot may be from what its cell says: the box within which no detector may cry wolf.

Owns the numbers; `canarm.draws` draws robots from them, and `thresholds` derives limits. What is measured must not
enter.
"""

PAYLOAD = -0.5, 0.8
"""Of the last link's mass: lighter or heavier by so much."""
COULOMB = 0.3, 2.7
"""Factors of Coulomb friction: from run-in to cold grease."""
VISCOUS = 1.0 / 3.0, 3.0
TORQUE_CONSTANT = 0.9, 1.1
NOISE = 0.5, 2.0
"""Factors of the noise of every analogue sensor."""
WIRE = 0.5, 2.0
"""Factors of the stiffness of a drive wire, where it is elastic; it may as well be rigid."""
OFFSET_DEG = 1.0
"""Either way, of a potentiometer's zero."""
START_DEG = 20.0
"""Either way, from the home pose to where the arm is parked."""
CYCLE_MS = 0.8, 10.0
