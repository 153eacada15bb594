import random
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

from seaid.errors import SymbolicError
from seaid.symbolic import RegressorForm, equations_of_motion, reduce, separate

t = sp.Symbol("t")
theta_M, theta_L, tau_M = (sp.Function(name)(t) for name in ("theta_M", "theta_L", "tau_M"))
I_M, F_v, F_C, k, r_M, r_L, N, c = sp.symbols("I_M F_v F_C k r_M r_L N c")
J, m, r, g, b = sp.symbols("J m r g b")
x, y, a = sp.symbols("x y a")
speed, load_speed = theta_M.diff(t), theta_L.diff(t)
SPRING = k * (r_M / N * theta_M - r_L * theta_L)
MOTOR = I_M * speed.diff(t) + F_v * speed + F_C * sp.sign(speed) + r_M / N * SPRING - tau_M  # (7)
LOAD = r_L * SPRING - J * load_speed.diff(t) - m * r * g * sp.sin(theta_L + b)  # (8), one joint
SIGNALS = [theta_M, theta_L, tau_M]


def same(left: RegressorForm, right: RegressorForm) -> bool:
    """True for forms that are equal symbol for symbol."""
    pairs = (
        (left.parameters, right.parameters),
        (left.zeta, right.zeta),
        (left.regressor, right.regressor),
    )
    return all(bool(one == other) for one, other in pairs)


def test_progress_is_shown_on_stderr_and_changes_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ([MOTOR, LOAD], SIGNALS, [F_v, F_C, k, J, m, r])
    quiet = separate(*asked)
    assert capsys.readouterr().err == ""
    assert same(separate(*asked, progress=True), quiet)
    said = capsys.readouterr()
    assert said.out == ""
    assert "equations read" in said.err
    assert "equations grouped" in said.err


def test_motor_side_becomes_equation_10() -> None:
    form = separate(MOTOR, motion=SIGNALS, unknowns=[F_v, F_C, k])
    assert form.zeta == sp.ImmutableMatrix([tau_M - I_M * speed.diff(t)])
    assert form.parameters == sp.ImmutableMatrix([F_v, F_C, k])
    spring = sp.expand(r_M / N * (r_M / N * theta_M - r_L * theta_L))
    assert form.regressor == sp.ImmutableMatrix([[speed, sp.sign(speed), spring]])


def test_a_term_of_the_user_gets_its_column_and_leaves_the_rest() -> None:
    form = separate(MOTOR + c * speed**3, motion=SIGNALS, unknowns=[F_v, F_C, k, c])
    plain = separate(MOTOR, motion=SIGNALS, unknowns=[F_v, F_C, k])
    assert form.zeta == plain.zeta
    assert form.regressor[:, :3] == plain.regressor
    assert form.regressor[0, 3] == speed**3


def test_load_side_keeps_the_scale_of_a_torque() -> None:
    form = separate(LOAD, motion=[theta_M, theta_L], unknowns=[J, m, r])
    assert form.zeta == sp.ImmutableMatrix([sp.expand(r_L * SPRING)])
    assert form.regressor[0, 0] == load_speed.diff(t)
    assert list(form.parameters) == [J, r * m]


def test_equation_without_known_terms_has_zeta_zero() -> None:
    form = separate([MOTOR, LOAD], motion=SIGNALS, unknowns=[F_v, F_C, k, J, m, r])
    assert list(form.zeta) == [tau_M - I_M * speed.diff(t), 0]
    assert list(form.parameters) == [F_v, F_C, k, J, m * r]
    assert sp.expand(form.regressor[1, :].dot(form.parameters) + sp.expand(LOAD, trig=True)) == 0


REWRITINGS: list[Callable[[sp.Expr], sp.Expr]] = [
    sp.expand,
    sp.together,
    sp.factor_terms,
    lambda e: sp.expand(e, trig=True),
    lambda e: e.subs(sp.sin(x) ** 2, 1 - sp.cos(x) ** 2),
    lambda e: e * (sp.sin(y) ** 2 + sp.cos(y) ** 2),
    lambda e: -e,
    lambda e: sp.Rational(3, 7) * e,
    lambda e: e * N,
    lambda e: e / (r_M * N),
    lambda e: e * (r_L + r_M),
    lambda e: sp.collect(sp.expand(e), [k, m, F_v]),
    lambda e: e + (F_v + x) ** 2 - sp.expand((F_v + x) ** 2),
    lambda e: sp.Add(*(term * N / N for term in sp.expand(e).args)),
    lambda e: 0.5 * e,
]
EQUATIONS = [
    F_v * x + F_C * sp.sign(x) + k * r_M / N * (r_M / N * y - r_L * sp.sin(x + 2 * y)) - a,
    k * (x - y * r_L) * (r_M + 1 / N) + m * r * sp.sin(x) ** 2 * (x + m) + a * N,
    m * r**2 * x + k * sp.exp(x) * (sp.exp(2 * x) + r_L) + F_v * sp.Abs(x) * x * r_M / (r_L + N),
    F_C * sp.sqrt(r_M**2 + r_L**2) * x - (m * sp.tan(x) + k) * sp.sin(y + sp.pi / 4) + a / N,
    F_v * x / (1 + y**2) + k * y / (r_M + x) - a * N,
]


@pytest.mark.slow  # forty equations, rewritten by sympy
@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(EQUATIONS), st.integers(0, 10**6), st.integers(1, 4))
def test_result_does_not_depend_on_how_an_equation_is_written(
    equation: sp.Expr, seed: int, steps: int
) -> None:
    unknowns = [F_v, F_C, k, m, r]
    rewritten = equation
    for rewriting in random.Random(seed).choices(REWRITINGS, k=steps):
        rewritten = rewriting(rewritten)
    assert same(separate(rewritten, [x, y, a], unknowns), separate(equation, [x, y, a], unknowns))


POINTS = [[sp.Rational(n, 11) for n in point] for point in ((3, 9, 22), (12, 4, 33), (7, 13, 5))]


@pytest.mark.parametrize("equation", EQUATIONS)
def test_regressor_times_parameters_is_the_equation(equation: sp.Expr) -> None:
    form = separate(equation, motion=[x, y, a], unknowns=[F_v, F_C, k, m, r])
    residual = (form.regressor * form.parameters - form.zeta)[0]
    values = {s: sp.Rational(3 + i, 7) for i, s in enumerate((F_v, F_C, k, m, r, r_M, r_L, N))}
    ratios = [
        (residual / equation).subs(values | dict(zip((x, y, a), point, strict=True))).evalf(30)
        for point in POINTS
    ]
    assert max(ratios) - min(ratios) < 1e-20 * abs(ratios[0])


DECIMALS = [
    (0.1, "1/10"),
    (-2.5e-7, "-1/4000000"),
    (0.28 * 0.28, "49/625"),  # 0.07840000000000001 in doubles
    (0.1 + 0.2 - 1, "-7/10"),
    (1 / 3, "3333333333333333/10000000000000000"),
    (1.2345678901234567, "12345678901234567/10000000000000000"),
    (sp.Float("0.1", 40), "1/10"),
    (sp.Float("0.12345678901234567890123", 40), "0.12345678901234567890123"),
]


@pytest.mark.parametrize(("given", "meant"), DECIMALS)
def test_floats_are_read_as_the_decimals_they_represent(given: float, meant: str) -> None:
    form = separate(given * F_v * x - a, motion=[x, a], unknowns=[F_v])
    assert form.regressor[0] == sp.Rational(meant) * x


def test_plain_symbols_of_torques_are_inputs_as_functions_of_time_are() -> None:
    """The row keeps the scale of the torque, whatever the lengths."""
    l0, u0 = sp.symbols("l0 u0")
    u = sp.Function("u")(t)
    rest = m * l0**2 * load_speed.diff(t) + m * g * l0 * sp.sin(theta_L)
    for row in (rest, rest / l0, 2 * rest + l0 * J * load_speed):
        plain, function = (separate(row - x, [theta_L], [m, J]) for x in (u0, u))
        assert plain.zeta == function.zeta.subs(u, u0)
        assert plain.regressor == function.regressor
    assert separate(rest - u0, [theta_L], [m]).zeta[0] == u0


def test_known_constants_in_products_are_no_inputs() -> None:
    """K i0 may be the torque, but which of them is the input is open: the shortest row."""
    K, i0 = sp.symbols("K i0")
    assert separate(m * g * sp.sin(x) - K * i0, [x], [m]).zeta[0] == i0 * K / g


def test_solved_equation_is_cleared_of_its_denominator() -> None:
    form = separate(sp.Eq(y, (a - m * g * sp.sin(x)) / (J + m * r**2)), [x, y, a], [J, m])
    assert form.zeta == sp.ImmutableMatrix([a])
    assert list(form.regressor) == [y, r**2 * y + g * sp.sin(x)]


def test_quotients_of_unknowns_are_one_parameter_where_that_keeps_the_known_side() -> None:
    form = separate(a - m / J * x - k * y, [x, y, a], [J, m, k])
    assert list(form.parameters) == [m / J, k]
    assert form.zeta == sp.ImmutableMatrix([a])


def test_an_unknown_gear_ratio_keeps_the_scale_of_both_sides() -> None:
    """(7) and (8) share k/N. N times (8), without a known term, would be solved by zeros."""
    motor = J * speed.diff(t) + F_v * speed + r_M / N * SPRING - tau_M
    load = r_L * SPRING - I_M * load_speed.diff(t) - m * sp.sin(theta_L)
    base = reduce(separate([motor, load], SIGNALS, [I_M, J, N, k, m, F_v]))
    assert list(base.parameters) == [I_M, J, k / N**2, k / N, k, m, F_v]
    assert base.ratios == ()
    # least squares with the values of the unknowns as truth
    values = {I_M: 0.3, J: 2e-4, N: 20, k: 50, m: 4, F_v: 0.01}
    symbols = sp.symbols("w0:6")
    rates = [speed.diff(t), load_speed.diff(t), speed, load_speed, theta_M, theta_L]
    R = base.regressor.subs(dict(zip(rates, symbols, strict=True)) | {r_M: 0.5, r_L: 0.4})
    rows = np.vstack([
        sp.lambdify([symbols], R)(row) for row in np.random.default_rng(0).normal(size=(20, 6))
    ])  # fmt: skip
    truth = np.array(base.parameters.subs(values), dtype=float).ravel()
    estimate = np.linalg.lstsq(rows, rows @ truth, rcond=None)[0]
    assert estimate[4] == pytest.approx(50, rel=1e-9)
    assert np.linalg.matrix_rank(rows) == 7


def test_quotients_in_an_undriven_row_stay() -> None:
    ball, beam, u = sp.Function("x")(t), sp.Function("q")(t), sp.Symbol("u")
    kinetic = I_M * beam.diff(t) ** 2 + m * (ball.diff(t) ** 2 + ball**2 * beam.diff(t) ** 2)
    lagrangian = (kinetic + J / r**2 * ball.diff(t) ** 2) / 2 - m * g * ball * sp.sin(beam)
    equations = equations_of_motion(lagrangian, [beam, ball], [u, 0])
    base = reduce(separate(equations, [beam, ball], [I_M, m, J, r]))
    assert list(base.parameters) == [I_M, m, J / r**2]
    passive = (m + J / N**2) * beam.diff(t, 2) + b * beam.diff(t) + g * beam.diff(t) ** 3
    assert list(reduce(separate(passive, [beam], [m, J, N, b])).parameters) == [m + J / N**2, b]


def test_quotients_stay_where_a_denominator_could_be_cleared_and_would_cost_a_column() -> None:
    """A condenser microphone: a movable plate, and a leak V/r next to the capacitor c/x."""
    plate, volts = sp.Function("x")(t), sp.Function("V")(t)
    equations = [
        m * plate.diff(t, 2) + b * plate.diff(t) + k * plate + c * (volts / plate) ** 2 / 2 - a,
        c * (volts / plate).diff(t) + volts / r - y,
    ]
    form = separate(equations, [plate, volts, a, y], [m, b, k, c, r])
    assert set(reduce(form).parameters) == {m, b, k, c, 1 / r}
    assert list(form.zeta) == [a, y]


PRODUCTS = [m, k, b, N, m / N, k / N, k / N**2, b / m, m * N, m**2, 1 / k, k * b, m / (N * k)]
MOVING = [x, y, x * y, sp.sin(x), x**2, y * sp.cos(x)]
KNOWN = [sp.Integer(1), sp.Integer(-2), r, 1 / r, r + 2]
TERMS = st.tuples(st.sampled_from(KNOWN), st.sampled_from(PRODUCTS), st.sampled_from(MOVING))
ROW = st.tuples(st.lists(TERMS, min_size=1, max_size=5), st.sampled_from([0, 0, -a, -a * r]))


def draws(count: int, size: int, seed: int) -> list[list[mpf]]:
    draw = random.Random(seed)
    return [[mpf(draw.randint(200, 2200)) / 1009 for _ in range(size)] for _ in range(count)]


def rank_of_differences(equations: list[sp.Expr], unknowns: list[sp.Symbol]) -> int:
    """The rank of what changes of the unknowns do to the equations at motions, by 40 digits.

    E(motion, theta) = R phi(theta) - zeta, so that E(., theta_i) - E(., theta_0) spans R's columns.
    """
    with mp.workdps(40):
        values = sp.lambdify([[x, y, a, r], unknowns], equations, "mpmath")
        motions = [[*motion, mpf(7) / 5] for motion in draws(8, 3, 1)]
        table = [
            [e for motion in motions for e in values(motion, theta)]
            for theta in draws(14, len(unknowns), 2)
        ]
        rows = [[e - e0 for e, e0 in zip(row, table[0], strict=True)] for row in table[1:]]
        rank = 0
        while rows:
            size, i, j = max(
                (abs(e), i, j) for i, row in enumerate(rows) for j, e in enumerate(row)
            )
            if size < mpf(10) ** -25:
                break
            top = rows.pop(i)
            rows = [
                [e - row[j] / top[j] * f for e, f in zip(row, top, strict=True)] for row in rows
            ]
            rank += 1
    return rank


def factors(equations: list[sp.Expr], form: RegressorForm, unknowns: list[sp.Symbol]) -> None:
    """R0 theta0 - zeta is each equation times a constant that no unknown and no motion changes."""
    base = reduce(form)
    residuals = list(base.regressor * base.parameters - base.zeta)
    with mp.workdps(40):
        arguments = [[x, y, a, r], unknowns]
        both = sp.lambdify(arguments, [equations, residuals], "mpmath")
        samples = zip(draws(4, 3, 3), draws(4, len(unknowns), 4), strict=True)
        pairs = [both([*motion, mpf(7) / 5], theta) for motion, theta in samples]
        for place in range(len(equations)):
            ratios = [residual[place] / equation[place] for equation, residual in pairs]
            assert max(abs(ratio - ratios[0]) for ratio in ratios) < mpf(10) ** -25


@settings(max_examples=7, deadline=None, derandomize=True)
@given(st.lists(ROW, min_size=1, max_size=3))
def test_scale_rank_and_equations_of_random_systems(
    rows: list[tuple[list[tuple[sp.Expr, sp.Expr, sp.Expr]], sp.Expr]],
) -> None:
    unknowns = [m, k, b, N]
    equations = [sp.Add(*map(sp.prod, terms)) + known for terms, known in rows]
    assume(all(sp.expand(e).has(*unknowns) for e in equations))
    form = separate(equations, [x, y, a], unknowns)
    factors(equations, form, unknowns)
    assert len(reduce(form).pivots) == rank_of_differences(equations, unknowns)


SUMS = [m + J, N + 1, m + J * sp.sin(x) ** 2, m * N + k * y, (m + J) * N]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(ROW, st.sampled_from(SUMS), st.booleans())
def test_sums_below_are_cleared_only_where_a_known_term_remains(
    row: tuple[list[tuple[sp.Expr, sp.Expr, sp.Expr]], sp.Expr], below: sp.Expr, whole: bool
) -> None:
    """No rewriting makes a row homogeneous: a known term stays, or the row is refused."""
    terms, known = row
    equation = sp.Add(*map(sp.prod, terms)) + known
    equation = equation / below if whole else equation + x * y**2 * m / below
    assume(sp.denom(sp.together(equation)).has(sp.Add))
    try:
        form = separate(equation, [x, y, a], [m, k, b, N, J])
    except SymbolicError as refusal:
        words = ("every term contains an unknown and nothing fixes their scale", "is empty")
        assert any(part in str(refusal) for part in words)  # noqa: PT017
    else:
        assert form.zeta[0] != 0
        assert reduce(form).ratios == ()


def test_columns_stand_in_the_order_of_the_unknowns_products_after_their_first_factor() -> None:
    equation = m * r * x + m * y + k * sp.cos(x) + m * k * x**2 - a
    assert list(separate(equation, [x, y, a], [k, r, m]).parameters) == [k, k * m, r * m, m]
    assert list(separate(equation, [x, y, a], [m, r, k]).parameters) == [m, r * m, k * m, k]


def test_an_unknown_that_no_equation_holds_keeps_a_zero_column() -> None:
    form = separate(m * x - a, [x, a], [J, m])
    assert list(form.parameters) == [J, m]
    assert list(form.regressor) == [0, x]


@pytest.mark.parametrize("container", [list, tuple, sp.Matrix, sp.ImmutableMatrix, sp.Tuple])
def test_equations_come_in_any_container(container: Callable[..., object]) -> None:
    given = (MOTOR, LOAD) if container is sp.Tuple else [MOTOR, LOAD]
    equations = container(*given) if container is sp.Tuple else container(given)
    unknowns = [F_v, F_C, k, J, m, r]
    assert same(separate(equations, SIGNALS, unknowns), separate([MOTOR, LOAD], SIGNALS, unknowns))


def test_undeclared_forces_are_inputs() -> None:
    form = separate(J * load_speed.diff(t) - tau_M, motion=[theta_L], unknowns=[J])
    assert form.zeta == sp.ImmutableMatrix([tau_M])


REFUSED = [
    (F_v * x + sp.sqrt(m) * a, [x, a], [F_v, m], ["equation 1", "a*sqrt(m)", "unknown m", "known"]),
    (m * sp.sin(k * x) - a, [x, a], [m, k], ["m*sin(k*x)", "unknown k is inside sin(k*x)"]),
    (x**m - a, [x, a], [m], ["unknown m is inside x**m"]),
    (m * x / (m + J) - a, [x, a], [m, J], ["denominator", "m*x/(J + m)", "cannot be cleared"]),
    (m * theta_M, [x], [m], ["theta_M(t) multiplies the unknown m", "not declared", "add it to"]),
    (m * x, [x, m], [m], ["m is both unknown and known", "remove it"]),
    (m * x, [x], [m, m], ["m is listed twice"]),
    (m * x, [x], [2 * m], ["unknowns contains 2*m", "symbols"]),
    (m * x, [x + 1], [m], ["motion contains x + 1", "functions of time"]),
    (m * x, [], [m], ["motion is empty"]),
    ([], [x], [m], ["equations is empty"]),
    (m * x, [x], [], ["unknowns is empty"]),
    (r * x, [x], [m, J], ["regressor is empty", "unknowns m, J", "same symbols"]),
    (m * x - m * x + a, [x, a], [m], ["regressor is empty", "cancel"]),
    (sp.Symbol("m", positive=True) * x, [x], [m], ["not the declared m", "assumptions"]),
    (m * x * sp.I, [x], [m], ["equation 1: found I;", "only real equations"]),
    (m * sp.exp(sp.I * x) - a, [x, a], [m], ["found I;", "sines and cosines"]),
    (m * sp.re(x) - a, [x, a], [m], ["found re(x);", "real"]),
    (m * x - sp.Symbol("a", imaginary=True), [x], [m], ["found a;", "real"]),
    (
        [m * x - a, m * sp.Integral(theta_M, t) - a],
        [theta_M, x, a],
        [m],
        ["equation 2: found Integral(theta_M(t), t)", "signal of its own"],
    ),
    (m * x + sp.oo, [x], [m], ["real numbers"]),
    (sp.true, [x], [m], ["an equation must be a scalar sympy expression, found True"]),
    (None, [x], [m], ["an equation must be a scalar sympy expression, found None"]),
    ("m x", [x], [m], ["an equation must be a scalar sympy expression"]),
    ([m * x > 0], [x], [m], ["an equation must be a scalar sympy expression"]),
    (m * (x + y + a + 1) ** 3000, [x, y, a], [m], ["too large", "terms", "raise max_terms"]),
    (m * sp.sin(10**7 * x), [x], [m], ["10000000 times", "1000"]),
]


@pytest.mark.parametrize(("equations", "motion", "unknowns", "words"), REFUSED)
def test_refusals_say_what_where_and_what_to_do(
    equations: sp.Expr, motion: list[sp.Expr], unknowns: list[sp.Symbol], words: list[str]
) -> None:
    with pytest.raises(SymbolicError) as caught:
        separate(equations, motion, unknowns)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_limit_of_terms_can_be_raised() -> None:
    equation = m * (x + y + a) ** 20
    with pytest.raises(SymbolicError, match="max_terms=100;"):
        separate(equation, [x, y, a], [m], max_terms=100)
    assert separate(equation, [x, y, a], [m], max_terms=231).regressor.shape == (1, 1)


def test_deeply_nested_equations_are_read() -> None:
    nested = sp.Integer(1)
    for _ in range(400):
        nested = (1 - sp.cos(x) ** 2 * (1 - nested)) * (sp.sin(x) ** 2 + nested * sp.cos(x) ** 2)
    form = separate(m * nested - a, [x, a], [m], max_terms=10_000)
    assert form.regressor[0].subs(x, 0) == 1


def test_an_unknown_phase_gives_two_parameters() -> None:
    phi, psi = sp.symbols("phi psi")
    form = separate(m * sp.sin(x + phi) + k * y - a, [x, y, a], [k, m, phi])
    assert list(form.parameters) == [k, m * sp.cos(phi), m * sp.sin(phi)]
    assert list(form.regressor) == [y, sp.sin(x), sp.cos(x)]
    assert reduce(form).pivots == (0, 1, 2)
    form = separate(sp.cos(2 * x - phi) + k * phi * y - a, [x, y, a], [k, phi])
    assert list(form.parameters) == [k * phi, sp.cos(phi), sp.sin(phi)]
    # the amplitude (m sin(x + phi))^2 has the mean m^2 / 2, so that cos^2 + sin^2 = 1 is used
    form = separate(m * sp.sin(x + phi) ** 2 - a, [x, a], [m, phi])
    assert list(form.parameters) == [m, m * sp.cos(phi) ** 2, m * sp.cos(phi) * sp.sin(phi)]
    both = separate(m * sp.sin(x + phi - psi) - a, [x, a], [m, phi, psi])
    assert len(both.parameters) == 4
    assert reduce(both).pivots == (0, 1)
    with pytest.raises(SymbolicError, match=r"unknown phi is inside sin\(phi\*x\)"):
        separate(m * sp.sin(x * phi) - a, [x, a], [m, phi])
    with pytest.raises(SymbolicError, match="cannot be cleared"):
        separate(m * sp.tan(x + phi) * y, [x, y, a], [m, phi])


q1, q2, u1, u2 = (sp.Function(name)(t) for name in ("q1", "q2", "u1", "u2"))


def test_signals_that_depend_on_each_other_are_declared() -> None:
    """Kane's speeds, a gear, and a chain of both; without the relations all are independent."""
    rolling = m * u1.diff(t) + r * q1.diff(t, 2) + k * u1 + c * q1.diff(t) - a
    unknowns, signals = [m, r, k, c], [q1, u1, a]
    assert reduce(separate(rolling, signals, unknowns)).pivots == (0, 1, 2, 3)
    form = separate(rolling, signals, unknowns, relations=sp.Eq(u1, q1.diff(t)))
    assert list(reduce(form).parameters) == [m + r, k + c]
    turning = m * u1 + r * sp.sin(q1) * u2 + k * q1.diff(t) - a
    speeds = [u1 - sp.cos(q1) * q2.diff(t) - q1.diff(t), u2 - q2.diff(t)]
    form = separate(turning, [q1, q2, u1, u2, a], [m, r, k], relations=speeds)
    assert list(form.regressor) == [
        q1.diff(t) + sp.cos(q1) * q2.diff(t),
        sp.sin(q1) * q2.diff(t),
        q1.diff(t),
    ]
    gear = m * q1.diff(t, 2) + r * q2.diff(t, 2) + k * sp.sin(q1) * sp.cos(q1) + c * sp.sin(q2) - a
    form = separate(gear, [q1, q2, a], unknowns, relations=[q2 - 2 * q1, 2 * q2 - 4 * q1])
    assert list(reduce(form).parameters) == [m + 2 * r, k + 2 * c]
    slow = [u2 - u1.diff(t), u1 - q1.diff(t)]
    form = separate(m * u2 + r * q1.diff(t, 2) - a, [q1, u1, u2, a], [m, r], relations=slow)
    assert list(reduce(form).parameters) == [m + r]


@pytest.mark.parametrize(
    ("relation", "words"),
    [
        (q1 - m * q2, ["contains an unknown", "as an equation"]),
        ("q1 = q2", ["a relation must be a scalar sympy expression"]),
    ],
)
def test_relations_that_are_not_between_signals_are_refused(
    relation: sp.Expr, words: list[str]
) -> None:
    with pytest.raises(SymbolicError) as caught:
        separate(m * q1 + r * q2 - a, [q1, q2, a], [m, r], relations=[relation])
    assert all(word in str(caught.value) for word in words), str(caught.value)


# Multiples of an angle, as a gear with many teeth has them: powers of sine and cosine would cancel.


def as_numbers(entries: sp.ImmutableMatrix, *signals: sp.Expr) -> Callable[..., list[float]]:
    """Return the entries as a function of the signals in double precision."""
    plain = [sp.Symbol(f"s{i}") for i in range(len(signals))]
    listed = list(entries.xreplace(dict(zip(signals, plain, strict=True))))
    found: Callable[..., list[float]] = sp.lambdify(plain, listed)
    return found


@pytest.mark.slow  # 0.6 s
@pytest.mark.parametrize("times", [1, 2, 3, 4, 5, 6, 9, 12, 20, 84, 137])
def test_multiples_of_an_angle_are_as_exact_as_the_sine(times: int) -> None:
    equation = m * sp.sin(times * x) + r * sp.cos(times * x) + J * x - a
    form = separate(equation, motion=[x, a], unknowns=[m, r, J])
    values = as_numbers(form.regressor, x)
    for angle in np.linspace(-3.0, 3.0, 13):
        direct = [np.sin(times * angle), np.cos(times * angle), angle]
        assert values(angle) == pytest.approx(direct, abs=2e-13)
    assert list(reduce(form).parameters) == [m, r, J]


def test_multiples_are_independent_exactly() -> None:
    """sin 83 x cos x = (sin 84 x + sin 82 x) / 2, which no number of digits hides."""
    unknowns = sp.symbols("p_1:6")
    functions = [sp.sin(84 * x), sp.sin(83 * x) * sp.cos(x), sp.sin(82 * x), sp.cos(x) ** 40]
    functions += [sp.cos(84 * x - y)]
    equation = sum(p * f for p, f in zip(unknowns, functions, strict=True)) - a
    base = reduce(separate(equation, [x, y, a], unknowns))
    p_1, p_2, p_3, p_4, p_5 = unknowns
    assert list(base.parameters) == [p_1 - p_3, p_2 + 2 * p_3, p_4, p_5]
    assert sp.sin(84 * x) in base.fundamental_functions
    values = as_numbers(base.regressor, x, y)
    assert values(0.7, 0.2)[0] == pytest.approx(np.sin(84 * 0.7), abs=1e-13)
    assert values(0.7, 0.2)[-1] == pytest.approx(np.cos(84 * 0.7 - 0.2), abs=1e-13)


def test_fractions_of_an_angle_and_products_of_two() -> None:
    equation = m * sp.sin(12 * x / 7) * sp.cos(9 * y) + r * sp.sin(x / 7) ** 12 - a
    form = separate(equation, [x, y, a], [m, r])
    at = (0.9, -1.3)
    direct = [np.sin(12 * at[0] / 7) * np.cos(9 * at[1]), np.sin(at[0] / 7) ** 12]
    assert as_numbers(form.regressor, x, y)(*at) == pytest.approx(direct, abs=1e-14)


def test_multiples_of_an_undeclared_angle_are_refused_too() -> None:
    with pytest.raises(SymbolicError, match=r"multiplies the unknown m and is not declared"):
        separate(m * sp.sin(30 * theta_M) - a, [x, a], [m])


def test_high_powers_in_a_denominator_stay() -> None:
    form = separate(m / (2 + sp.cos(x) ** 8) + r * sp.cos(9 * x) - a, [x, a], [m, r])
    assert as_numbers(form.regressor, x)(0.3)[0] == pytest.approx(1 / (2 + np.cos(0.3) ** 8))
