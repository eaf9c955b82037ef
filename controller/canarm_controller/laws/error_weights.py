"""Weights of an error and its rate in an adaptation that is stable by Lyapunov's second method."""


def error_weights(omega_rad_s: float, damping: float) -> tuple[float, float]:
    """p12 and p22 of z = p12·e + p22·ė for a reference model of second order.

    They are entries of P, the solution of AᵀP + PA = -Q for the model's A and Q = diag(q1, q2), q1 = 2ωn², q2 = 1:
    p12 = q1/2ωn², p22 = (q2 + 2·p12)/4ζωn.
    """
    q1, q2 = 2.0 * omega_rad_s**2, 1.0
    p12 = q1 / (2.0 * omega_rad_s**2)
    return p12, (q2 + 2.0 * p12) / (4.0 * damping * omega_rad_s)
