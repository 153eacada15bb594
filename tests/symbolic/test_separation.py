import sympy as sp

from seaid.symbolic import separate

t = sp.Symbol("t")
theta_M, theta_L, tau_M = (sp.Function(name)(t) for name in ("theta_M", "theta_L", "tau_M"))
I_M, F_v, F_C, k, r_M, r_L, N = sp.symbols("I_M F_v F_C k r_M r_L N")
speed = theta_M.diff(t)
MOTOR = (  # (7)
    I_M * speed.diff(t)
    + F_v * speed
    + F_C * sp.sign(speed)
    + k * r_M / N * (r_M / N * theta_M - r_L * theta_L)
    - tau_M
)


def test_motor_side_becomes_equation_10() -> None:
    form = separate(MOTOR, motion=[theta_M, theta_L, tau_M], unknowns=[F_v, F_C, k])
    assert form.zeta == sp.ImmutableMatrix([tau_M - I_M * speed.diff(t)])
    assert form.parameters == sp.ImmutableMatrix([F_v, F_C, k])
    spring = sp.expand(r_M / N * (r_M / N * theta_M - r_L * theta_L))
    assert form.regressor == sp.ImmutableMatrix([[speed, sp.sign(speed), spring]])
