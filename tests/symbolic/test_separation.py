import random
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

from seaid.errors import SeaidWarning, SymbolicError
from seaid.symbolic import RegressorForm, reduce, separate
from tests.symbolic.systems import DIGITS, leftmost

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


def test_motor_and_load_side_become_equations_10_and_8_and_share_their_spring() -> None:
    """Columns, known sides and parameters as in the paper; a further term gets its own column."""
    spring = sp.expand(r_M / N * (r_M / N * theta_M - r_L * theta_L))
    motor = separate(MOTOR + c * speed**3, motion=SIGNALS, unknowns=[F_v, F_C, k, c])
    assert list(motor.parameters) == [F_v, F_C, k, c]
    assert list(motor.regressor) == [speed, sp.sign(speed), spring, speed**3]
    assert list(motor.zeta) == [tau_M - I_M * speed.diff(t)]
    load = separate(LOAD, motion=[theta_M, theta_L], unknowns=[J, m, r])
    assert list(load.zeta) == [sp.expand(r_L * SPRING)]  # it keeps the scale of a torque
    assert list(load.parameters) == [J, r * m]
    assert load.regressor[0, 0] == load_speed.diff(t)
    both = separate([MOTOR, LOAD], motion=SIGNALS, unknowns=[F_v, F_C, k, J, m, r])
    assert list(both.zeta) == [tau_M - I_M * speed.diff(t), 0]
    assert list(both.parameters) == [F_v, F_C, k, J, m * r]
    assert sp.expand(both.regressor[1, :].dot(both.parameters) + sp.expand(LOAD, trig=True)) == 0


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
    """A product of decimals in doubles is the decimal that was meant."""
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
    # of K i0 either may be the input: the shortest row
    assert separate(m * g * sp.sin(x) - K * i0, [x], [m]).zeta[0] == i0 * K / g


phi, psi, K, i0 = sp.symbols("phi psi K i0")
FORMS = [
    # solved for an acceleration, with quotients, in the order of the unknowns, with a zero column
    (y - (a - m * g * sp.sin(x)) / (J + m * r**2), [J, m], [J, m], [y, r**2 * y + g * sp.sin(x)]),
    (a - m / J * x - k * y, [J, m, k], [m / J, k], [x, y]),
    (m * r * x + m * y + k * x**2 + m * k - a, [k, r, m], [k, k * m, r * m, m], [x**2, 1, x, y]),
    (m * r * x + m * y + k * x**2 + m * k - a, [m, r, k], [m, r * m, k * m, k], [y, x, 1, x**2]),
    (m * x - a, [J, m], [J, m], [0, x]),
    # unknown phases
    (
        m * sp.sin(x + phi) + k * y - a,
        *([k, m, phi], [k, m * sp.cos(phi), m * sp.sin(phi)], [y, sp.sin(x), sp.cos(x)]),
    ),
    (
        sp.cos(2 * x - phi) + k * phi * y - a,
        *([k, phi], [k * phi, sp.cos(phi), sp.sin(phi)]),
        [y, 2 * sp.cos(x) ** 2 - 1, 2 * sp.sin(x) * sp.cos(x)],
    ),
    # the amplitude (m sin(x + phi))^2 has the mean m^2 / 2, so that cos^2 + sin^2 = 1 is used
    (
        m * sp.sin(x + phi) ** 2 - a,
        *([m, phi], [m, m * sp.cos(phi) ** 2, m * sp.cos(phi) * sp.sin(phi)]),
        [sp.cos(x) ** 2, 1 - 2 * sp.cos(x) ** 2, 2 * sp.sin(x) * sp.cos(x)],
    ),
]


@pytest.mark.parametrize(("equation", "unknowns", "parameters", "regressor"), FORMS)
def test_products_of_unknowns_and_their_columns(
    equation: sp.Expr,
    unknowns: list[sp.Symbol],
    parameters: list[sp.Expr],
    regressor: list[sp.Expr],
) -> None:
    """The known side stays a, and each parameter stands at its first factor."""
    form = separate(equation, [x, y, a], unknowns)
    assert list(form.parameters) == parameters
    assert [
        sp.expand(column - expected)
        for column, expected in zip(form.regressor, regressor, strict=True)
    ] == [0] * len(regressor)
    assert list(form.zeta) == [a]
    assert reduce(form).pivots == tuple(n for n, column in enumerate(regressor) if column != 0)


q1, q2, u1, u2 = (sp.Function(name)(t) for name in ("q1", "q2", "u1", "u2"))
ROLLING = m * u1.diff(t) + r * q1.diff(t, 2) + k * u1 + c * q1.diff(t) - a
GEAR = m * q1.diff(t, 2) + r * q2.diff(t, 2) + k * sp.sin(q1) * sp.cos(q1) + c * sp.sin(q2) - a
BALL = [
    (I_M + m * q1**2) * q2.diff(t, 2)
    + 2 * m * q1 * q1.diff(t) * q2.diff(t)
    + m * g * q1 * sp.cos(q2)
    - a,
    (m + J / r**2) * q1.diff(t, 2) - m * q1 * q2.diff(t) ** 2 + m * g * sp.sin(q2),
]
PASSIVE = (m + J / N**2) * q1.diff(t, 2) + b * q1.diff(t) + g * q1.diff(t) ** 3
MICROPHONE = [  # a movable plate, and a leak u1 / r next to the capacitor c / q1
    m * q1.diff(t, 2) + b * q1.diff(t) + k * q1 + c * (u1 / q1) ** 2 / 2 - a,
    c * (u1 / q1).diff(t) + u1 / r - y,
]
GEARED = [
    J * speed.diff(t) + F_v * speed + r_M / N * SPRING - tau_M,
    r_L * SPRING - I_M * load_speed.diff(t) - m * sp.sin(theta_L),
]
SLOW = m * u2 + r * q1.diff(t, 2) - a
TURNING = m * u1 + r * sp.sin(q1) * u2 + k * q1.diff(t) - a
KANE = [u1 - sp.cos(q1) * q2.diff(t) - q1.diff(t), u2 - q2.diff(t)]
BASES = [
    # quotients of unknowns: (7) and (8) share k/N; N times (8) would be solved by zeros
    (GEARED, [], SIGNALS, [I_M, J, N, k, m, F_v], [I_M, J, k / N**2, k / N, k, m, F_v]),
    (BALL, [], [q1, q2, a], [I_M, m, J, r], [I_M, m, J / r**2]),
    (PASSIVE, [], [q1], [m, J, N, b], [m + J / N**2, b]),
    (MICROPHONE, [], [q1, u1, a, y], [m, b, k, c, r], [m, b, k, c, 1 / r]),
    # signals that depend on each other: Kane's speeds, a gear, a chain of both
    (ROLLING, [], [q1, u1, a], [m, r, k, c], [m, r, k, c]),
    (ROLLING, sp.Eq(u1, q1.diff(t)), [q1, u1, a], [m, r, k, c], [m + r, k + c]),
    (GEAR, [q2 - 2 * q1, 2 * q2 - 4 * q1], [q1, q2, a], [m, r, k, c], [m + 2 * r, k + 2 * c]),
    (TURNING, KANE, [q1, q2, u1, u2, a], [m, r, k], [m, r, k]),
    (SLOW, [u2 - u1.diff(t), u1 - q1.diff(t)], [q1, u1, u2, a], [m, r], [m + r]),
]


@pytest.mark.parametrize(("equations", "relations", "motion", "unknowns", "base"), BASES)
def test_quotients_of_unknowns_and_relations_of_signals(
    equations: sp.Expr,
    relations: sp.Expr,
    motion: list[sp.Expr],
    unknowns: list[sp.Symbol],
    base: list[sp.Expr],
) -> None:
    """Products and quotients are parameters where that costs no column and no known side."""
    found = reduce(separate(equations, motion, unknowns, relations=relations))
    assert list(found.parameters) == base
    assert found.ratios == (() if found.zeta.norm() != 0 else (tuple(base),))


PRODUCTS = [m, k, b, N, m / N, k / N, k / N**2, b / m, m * N, m**2, 1 / k, k * b, m / (N * k)]
MOVING = [x, y, x * y, sp.sin(x), x**2, y * sp.cos(x)]
KNOWN = [sp.Integer(1), sp.Integer(-2), r, 1 / r, r + 2]
TERMS = st.tuples(st.sampled_from(KNOWN), st.sampled_from(PRODUCTS), st.sampled_from(MOVING))
ROW = st.tuples(st.lists(TERMS, min_size=1, max_size=5), st.sampled_from([0, 0, -a, -a * r]))


def draws(count: int, size: int, seed: int) -> list[list[mpf]]:
    draw = random.Random(seed)
    return [[mpf(draw.randint(200, 2200)) / 1009 for _ in range(size)] for _ in range(count)]


def rank_of_differences(equations: list[sp.Expr], unknowns: list[sp.Symbol]) -> int:
    """The rank of what changes of the unknowns do to the equations at motions, by 50 digits.

    E(motion, theta) = R phi(theta) - zeta, so that E(., theta_i) - E(., theta_0) spans R's columns.
    """
    with mp.workdps(DIGITS):
        values = sp.lambdify([[x, y, a, r], unknowns], equations, "mpmath")
        motions = [[*motion, mpf(7) / 5] for motion in draws(8, 3, 1)]
        first, *table = [
            [e for motion in motions for e in values(motion, theta)]
            for theta in draws(14, len(unknowns), 2)
        ]
        return len(leftmost([[e - e0 for e, e0 in zip(row, first, strict=True)] for row in table]))


def check_factors(equations: list[sp.Expr], form: RegressorForm, unknowns: list[sp.Symbol]) -> None:
    """R0 theta0 - zeta is each equation times a constant that no unknown and no motion changes."""
    base = reduce(form)
    residuals = list(base.regressor * base.parameters - base.zeta)
    known = [constant for constant in (r, r_M, r_L, N) if constant not in unknowns]
    with mp.workdps(DIGITS):
        both = sp.lambdify([[x, y, a, *known], unknowns], [equations, residuals], "mpmath")
        samples = zip(draws(4, 3, 3), draws(4, len(unknowns), 4), strict=True)
        numbers = draws(1, len(known), 5)[0]
        pairs = [both([*motion, *numbers], theta) for motion, theta in samples]
        for place in range(len(equations)):
            ratios = [residual[place] / equation[place] for equation, residual in pairs]
            assert max(abs(ratio - ratios[0]) for ratio in ratios) < mpf(10) ** -25


@pytest.mark.parametrize("equation", EQUATIONS)
def test_regressor_times_parameters_is_the_equation(equation: sp.Expr) -> None:
    """Of square roots, tangents, quotients and exponentials, up to a constant factor."""
    unknowns = [F_v, F_C, k, m, r]
    check_factors([equation], separate(equation, [x, y, a], unknowns), unknowns)


@settings(max_examples=7, deadline=None, derandomize=True)
@given(st.lists(ROW, min_size=1, max_size=3))
def test_scale_rank_and_equations_of_random_systems(
    rows: list[tuple[list[tuple[sp.Expr, sp.Expr, sp.Expr]], sp.Expr]],
) -> None:
    unknowns = [m, k, b, N]
    equations = [sp.Add(*map(sp.prod, terms)) + known for terms, known in rows]
    assume(all(sp.expand(e).has(*unknowns) for e in equations))
    form = separate(equations, [x, y, a], unknowns)
    check_factors(equations, form, unknowns)
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
    (None, [x], [m], ["an equation must be a scalar sympy expression, found None"]),
    ([m * x > 0], [x], [m], ["an equation must be a scalar sympy expression"]),
    (m * (x + y + a + 1) ** 3000, [x, y, a], [m], ["too large", "terms", "raise max_terms"]),
    (m * sp.sin(30 * theta_M) - a, [x, a], [m], ["multiplies the unknown m and is not declared"]),
    (m * sp.sin(x * r) - a, [x, a], [m, r], ["unknown r is inside sin(r*x)"]),
    (m * sp.tan(x + r) * y, [x, y, a], [m, r], ["cannot be cleared"]),
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


# Multiples of an angle, as gears with many teeth have, would cancel in powers of sine and cosine.
ANGLES = [
    *([sp.sin(n * x), sp.cos(n * x), x] for n in (2, 9, 137)),
    [sp.sin(12 * x / 7) * sp.cos(9 * y), sp.sin(x / 7) ** 12],
    [1 / (2 + sp.cos(x) ** 8), sp.cos(9 * x)],
    [sp.sin(84 * x), sp.sin(83 * x) * sp.cos(x), sp.cos(x) ** 40, sp.cos(84 * x - y)],
]


@pytest.mark.parametrize("functions", ANGLES)
def test_multiples_of_an_angle_are_as_exact_as_the_sine(functions: list[sp.Expr]) -> None:
    unknowns = [m, r, J, k][: len(functions)]
    equation = sp.Add(*map(sp.Mul, unknowns, functions)) - a
    form = separate(equation, [x, y, a], unknowns)
    found, direct = (sp.lambdify([x, y], list(each)) for each in (form.regressor, functions))
    for angle in np.linspace(-3.0, 3.0, 13):
        assert found(angle, 0.2) == pytest.approx(direct(angle, 0.2), abs=2e-13)
    assert list(reduce(form).parameters) == unknowns


def test_multiples_that_depend_on_each_other_are_replaced() -> None:
    functions = [sp.sin(84 * x), sp.sin(83 * x) * sp.cos(x), sp.sin(82 * x)]
    form = separate(sp.Add(*map(sp.Mul, [m, r, J], functions)) - a, [x, a], [m, r, J])
    with pytest.warns(SeaidWarning, match=r"sin\(83\*x\)\*cos\(x\) = sin\(82\*x\)/2 \+"):
        assert list(reduce(form).parameters) == [m - J, r + 2 * J]
