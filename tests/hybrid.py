"""Hybrid systems: f, events, a start, and the exact events and ends of their motions."""

from dataclasses import dataclass, field
from math import log

import numpy as np
from scipy.optimize import brentq

from suslov_fast import Event, Status

pi = np.pi


@dataclass
class Hybrid:
    """A system; `times` are those of each event, and `order` tells which come one after another.

    A motion ends at `stop` by a `status` other than OK. Where `is_smooth`, times and states have
    derivatives by the start and by parameters.
    """

    f: object
    names: str
    start: list
    time: float
    events: list = field(default_factory=list)
    times: list = field(default_factory=list)
    end: list = None
    parameters: dict = field(default_factory=dict)
    order: list = None
    status: Status = Status.OK
    stop: float = np.nan
    digits: float = 1e-8
    is_smooth: bool = True

    @property
    def which(self):
        if self.order is not None:
            return self.order
        which = np.repeat(np.arange(len(self.times)), [len(own) for own in self.times])
        return which[np.argsort(np.concatenate([[], *self.times]), kind="stable")].tolist()


def clock(s):
    return 1.0, 0.0


def oscillator(s):
    return s[1], -s[0]


def ball(s, g, e):
    return s[1], -g


def friction(s, mu):
    return s[1], -s[0] - mu * np.sign(s[1])


def patient(s, k, dose):
    return -k * s[0], k * s[0] - 0.1 * s[1]


def amounts(times, k, dose, t):
    """Return the amounts in gut and blood at time t, after doses at these times."""
    s = t - np.asarray(times, float)
    s = s[s >= 0.0]
    in_gut, out = np.exp(-k * s), np.exp(-0.1 * s)
    return dose * np.array([in_gut.sum(), k / (0.1 - k) * (in_gut - out).sum()])


def bounces(h, v, g, e, T):
    """Return when a ball bounces up to time T, and its height and velocity then."""
    speed = np.sqrt(v * v + 2.0 * g * h)
    times = [(v + speed) / g]
    while times[-1] + 2.0 * e * speed / g < T:
        speed *= e
        times.append(times[-1] + 2.0 * speed / g)
    s, speed = T - times[-1], e * speed
    return times, [speed * s - g * s * s / 2.0, speed - g * s]


def on_a_spring(T):
    """Return when a ball from height 1 meets and leaves a spring, and its state at time T."""
    g, w = 9.81, np.sqrt(1000.0)
    v = np.sqrt(2.0 * g)
    fall, contact = v / g, (pi + 2.0 * np.arctan(g / (w * v))) / w
    n, s = divmod(T + fall, 2.0 * fall + contact)  # since the ball has left the spring
    begins = fall + (2.0 * fall + contact) * np.arange(n + 1.0)
    times = np.stack([begins, begins + contact], axis=1).ravel()
    u = s - 2.0 * fall
    state = [v * s - g * s * s / 2.0, v - g * s]
    if u > 0.0:
        a, b = g / w**2, -v / w
        c, d = np.cos(w * u), np.sin(w * u)
        state = [a * c + b * d - a, w * (b * c - a * d)]
    return times[times < T], state


def crossed(function, brackets):
    return [brentq(function, *ends, xtol=1e-14) for ends in brackets]


def stopping(s):
    """Return the state after a bounce, or at rest if the ball is slower than 1/1000."""
    is_slow = np.abs(s[1]) < 1e-3
    return np.where(is_slow, 0, s[0]), np.where(is_slow, 0, -0.8 * s[1]), np.where(is_slow, 0, s[2])


BOUNCE = Event("h", direction=-1, to=lambda s, e: (s[0], -e * s[1]))
SECTION = np.arange(1, 11) - 0.5  # half turns after which a cosine is 0
PHASE, ARC = np.arctan(0.5), np.arcsin(0.2 / np.sqrt(1.25))
OF_BALL, OF_ELASTIC = {"g": 9.81, "e": 0.8}, bounces(1.0, 0.3, 9.81, 0.8, 3.0)
TO_BLOOD = {"to": lambda s, dose: (s[0] + dose, s[1])}
SPEED = np.sqrt(1.51)  # of a fall with friction, which takes the time SLIPS
SLIPS = (SPEED - 0.1) / 0.75
OF_SPRING = on_a_spring(4.6)
SLOWED = np.sqrt(4.0 - 2 * 300 * 0.002)  # the speed after a slab
LEVELS = np.linspace(0.25, 9.75, 20)
MIRROR = 3.2658904471899737
MET = np.cumsum([MIRROR - 3.2651775356457717, 4 * MIRROR]) / 9.79767134156992
OF_PRODUCT = np.add.outer(pi / 2 * np.arange(65), np.arcsin(np.sqrt(0.96)) / 2 * np.array([-1, 1]))
SYSTEMS = {
    # ------------------------------------------------------------------------ records of surfaces
    "oscillator": Hybrid(
        oscillator, "q p", [1.0, 0.5], 20.0, [Event("q"), Event(lambda s: s[1] - 0.2)],
        [PHASE + pi * SECTION[:6], np.sort([*(PHASE - ARC + 2 * pi * np.arange(4)),
                                            *(PHASE + ARC + pi * np.arange(1, 7, 2))])],
        [np.cos(20.0) + 0.5 * np.sin(20.0), 0.5 * np.cos(20.0) - np.sin(20.0)],
    ),
    "a surface and its double": Hybrid(
        oscillator, "q p", [1.0, 0.0], 4.0, [Event("q"), Event(lambda s: s[0])], [[pi / 2]] * 2,
        [np.cos(4.0), -np.sin(4.0)],
    ),
    "a product of waves": Hybrid(
        lambda s: (1.0,), "t", [0.1], 99.9,
        [Event(lambda s: np.sin(s[0]) ** 2 * np.cos(s[0]) ** 2 - 0.24)],
        [np.sort(OF_PRODUCT[(OF_PRODUCT > 0.1) & (OF_PRODUCT < 100.0)]) - 0.1], [100.0],
    ),
    "decay to a level": Hybrid(
        lambda s, k, level: (-k * s[0],), "c", [3.0], 4.0, [Event(lambda s, level: s[0] - level)],
        [[2 * np.log(2.0)]], [3 * np.exp(-2.0)], {"k": 0.5, "level": 1.5},
    ),
    "a ball on a spring": Hybrid(
        lambda s, w: (s[1], -9.81 - np.where(s[0] < 0, w * s[0], 0.0)), "h v", [1.0, 0.0], 4.6,
        [Event("h")], [OF_SPRING[0]], OF_SPRING[1], {"w": 1000.0}, digits=1e-7,
    ),
    "a surface of a parameter where f jumps": Hybrid(
        lambda s, a: (np.where(s[0] > 1, 2.0, 1.0),), "x", [0.0], 2.0,
        [Event(lambda s: s[0] - 1), Event(lambda s, a: s[0] - 1 - a)], [[1.0], [1.2]], [3.0],
        {"a": 0.4}, digits=1e-11,
    ),
    "friction that holds": Hybrid(
        friction, "x v", [1.0, 0.0], 12.0, [Event("v")], [[pi, 2 * pi, 3 * pi]],
        [-0.1, 0.0], parameters={"mu": 0.15}, is_smooth=False,
    ),
    # ------------------------------------------------------------------------- actions at surfaces
    "a ball": Hybrid(ball, "h v", [1.0, 0.3], 3.0, [BOUNCE], [OF_ELASTIC[0]], OF_ELASTIC[1],
                     OF_BALL),
    "a ball that stays on the floor": Hybrid(  # by a variable that is 0 from the last bounce on
        lambda s: (s[2] * s[1], -9.81 * s[2], 0 * s[2]), "h v flies", [1.0, 0.0, 1.0], 10.0,
        [Event("h", direction=-1, to=stopping)],
        [np.sqrt(2 / 9.81) * np.cumsum([1.0, *(2 * 0.8 ** np.arange(1, 39))])], [0.0, 0.0, 0.0],
        is_smooth=False,
    ),
    "a bounce with friction": Hybrid(  # f has the other sign after it
        lambda s, mu: (s[1], -1 - mu * np.sign(s[1])), "h v", [1.0, -0.1], 2.0,
        [Event("h", direction=-1, to=lambda s: (s[0], -s[1]))], [[SLIPS]],
        [SPEED * (2 - SLIPS) - 0.625 * (2 - SLIPS) ** 2, SPEED - 1.25 * (2 - SLIPS)],
        {"mu": 0.25},
    ),
    "a neuron": Hybrid(
        lambda s, I, threshold: (I - s[0],), "v", [0.0], 7.3,
        [Event(lambda s, threshold: s[0] - threshold, direction="up", to=lambda s: (0,))],
        [log(3) * np.arange(1, 7)], [1.5 - 1.5 * np.exp(6 * log(3) - 7.3)],
        {"I": 1.5, "threshold": 1.0},
    ),
    "a new state that chooses": Hybrid(
        clock, "t n", [0.0, 0.0], 5.0,
        [Event(lambda s: np.abs(s[0] - 2) - 1, to=lambda s: (s[0], np.where(s[1] > 0, 7, 1)))],
        [[1.0, 3.0]], [5.0, 7.0], is_smooth=False,
    ),
    "a line that stops": Hybrid(  # it stays where its change has put it
        lambda s: (s[1], 0 * s[1]), "x v", [0.0, 1.0], 20.0,
        [Event(lambda s: s[0] - 1, to=("x", 0))], [[1.0]], [1.0, 0.0], is_smooth=False,
    ),
    "a clock that is copied": Hybrid(
        lambda s, b: (0.1 * s[0], 0.0, 1.0), "x last t", [1.0, -1.0, 10.0], 5.0,
        [Event(times=[3.0], to=lambda s, b: (s[0], s[2] * b, s[2]))], [[3.0]],
        [np.exp(0.5), 19.5, 15.0], {"b": 1.5},
    ),
    "a mirror that is met at once": Hybrid(  # with rounding errors of a step
        lambda s: (s[1], 0.0), "x v", [-3.2651775356457717, -9.79767134156992], 2.0,
        [Event(f"x - {MIRROR}", direction="up", to=("-x", "v/2")),
         Event(f"x + {MIRROR}", direction="down", to=("-x", "v/2"))], [[], MET],
        [MIRROR - 9.79767134156992 / 4 * (2 - MET[1]), -9.79767134156992 / 4], is_smooth=False,
    ),
    "a valve": Hybrid(
        lambda s: ((1 - s[1]) * (10 - s[0]), 0.0), "out sat", [0.0, 0.0], 10.0,
        [Event(lambda s: s[0] - 1, to=("out", 1)), Event(times=[5], to=(0.5, 0))],
        [[log(10 / 9), 5 + log(9.5 / 9)], [5.0]], [1.0, 1.0], is_smooth=False,
    ),
    # --------------------------------------------------------------------- times, and one instant
    "doses": Hybrid(
        patient, "gut blood", [0.0, 0.0], 90.0,
        [Event(times=[0, 12, np.nan, 24, -1], **TO_BLOOD),
         Event(lambda s: s[1] - 50, direction="down")],
        [[0.0, 12.0, 24.0],
         crossed(lambda t: amounts([0, 12, 24], 0.7, 100.0, t)[1] - 50,
                 [(8, 11.9), (20, 23.9), (26, 60)])],
        amounts([0, 12, 24], 0.7, 100.0, 90.0), {"k": 0.7, "dose": 100.0},
    ),
    "two times at once": Hybrid(
        clock, "t n", [0.0, 0.0], 2.0,
        [Event(times=[1, 1], to=lambda s: (s[0], s[1] + 12)),
         Event(times=[1], to=lambda s: (s[0], 10 * s[1]))], [[1.0, 1.0], [1.0]], [2.0, 240.0],
    ),
    "two surfaces at once": Hybrid(
        clock, "t n", [0.0, 0.0], 2.0,
        [Event(lambda s: s[0] - 1, to=lambda s: (s[0], s[1] + 1)),
         Event(lambda s: 2 * s[0] - 2, to=lambda s: (s[0], 10 * s[1]))], [[1.0], [1.0]],
        [2.0, 10.0],
    ),
    "a change that crosses another surface": Hybrid(  # it moves with the time of the first
        lambda s, a: (1.0 + 0.5 * s[1], 0.0), "t r", [0.0, 0.0], 2.0,
        [Event(lambda s, a: s[0] - a, direction=1, to=lambda s: (s[0] + 1, 1)),
         Event(lambda s: s[0] - 1.5, direction=1, to=lambda s: (2 * s[0], 3 * s[1]))],
        [[1.0], [1.0]], [6.5, 3.0], {"a": 1.0},
    ),
    "doses over a threshold": Hybrid(
        lambda s: (-s[0], 0.0), "x n", [0.0, 0.0], 1.5,
        [Event(lambda s: s[0] - 1, direction=1, to=lambda s: (0.5, s[1] + 1)),
         Event(times=[0, 1], to=lambda s: (s[0] + 2, s[1]))], [[0.0, 1.0]] * 2,
        [0.5 * np.exp(-0.5), 2.0], order=[1, 0, 1, 0], is_smooth=False,
    ),
    "doses over a section": Hybrid(
        lambda s: (-s[0],), "x", [0.0], 2.5,
        [Event(lambda s: s[0] - 1), Event(times=[0, 2], to=lambda s: (s[0] + 2,))],
        [[0.0, log(2), 2.0], [0.0, 2.0]], [2 * np.exp(-2.5) + 2 * np.exp(-0.5)],
        order=[1, 0, 0, 1, 0], is_smooth=False,
    ),
    "each state of an instant": Hybrid(
        lambda s: (1.0,), "x", [0.0], 1.0,
        [Event(times=[0.5], to=lambda s: (s[0] + 5,)), Event(lambda s: s[0] - 1),
         Event(lambda s: s[0] - 4, direction=1, to=lambda s: (s[0] - 5.2,))],
        [[0.5], [0.5, 0.5], [0.5]], [0.8], order=[0, 1, 2, 1],
    ),
    "a ball at rest that is kicked": Hybrid(
        lambda s: (s[1], -9.8), "h v", [0.0, 0.0], 1.1,
        [Event("h", direction=-1, to=("h", "-v/2")), Event(times=[0], to=(0, 5))],
        [[10 / 9.8], [0.0]],
        [2.5 * (1.1 - 10 / 9.8) - 4.9 * (1.1 - 10 / 9.8) ** 2, 2.5 - 9.8 * (1.1 - 10 / 9.8)],
        is_smooth=False,
    ),
    # -------------------------------------------------------------------- f that chooses, no event
    "a stiff relay": Hybrid(
        lambda s, k: (-k * (s[0] - np.where(s[1] > 1, 2.0, 1.0)), 1.0), "x t", [0.0, 0.0], 1.001,
        end=[2 - np.exp(-1.0), 1.001], parameters={"k": 1000.0}, is_smooth=False,
    ),
    "jumps of an acceleration": Hybrid(
        lambda s, a, b: (s[1], np.where(s[0] > 0, -a, b)), "x v", [0.195, 0.5], 4.7,
        end=[0.14, 0.6], parameters={"a": 1.0, "b": 2.0},
    ),
    "a dose as a condition": Hybrid(
        lambda s, k, begin, dose: (
            np.where((s[1] > begin) & (s[1] < begin + 2), dose, 0.0) - k * s[0], 1.0
        ), "c t", [0.0, 0.0], 6.0,
        end=[5 / 0.3 * (np.exp(-0.3 * 2.5) - np.exp(-0.3 * 4.5)), 6.0],
        parameters={"k": 0.3, "begin": 1.5, "dose": 5.0},
    ),
    "a kink": Hybrid(  # half a turn with the square of the rate 1.5, half a one with 0.5
        lambda s, a: (s[1], -s[0] - a * abs(s[0])), "x v", [2.0, 0.0],
        10 * (pi / np.sqrt(1.5) + pi / np.sqrt(0.5)), end=[2.0, 0.0], parameters={"a": 0.5},
    ),
    "a table of the state": Hybrid(  # x' = 1, 3, 1/2 where x < 1, 1 <= x < 2, 2 <= x
        lambda s: (np.interp(s[0], [0, 1, 1, 2, 2, 9], [1, 1, 3, 3, 0.5, 0.5]),), "x", [0.0], 3.0,
        end=[2 + 5 / 6],
    ),
    "a thin slab": Hybrid(  # of which each side would be seen alone
        lambda s: (s[1], np.where((s[0] > 1.0) & (s[0] < 1.002), -300.0, 0.0)), "x v", [0.0, 2.0],
        20.0, end=[1.002 + SLOWED * (19.5 - 0.004 / (2 + SLOWED)), SLOWED],
    ),
    "stairs of the state": Hybrid(  # x' = 1 + the number of levels below x
        lambda s: (1.0 + (s[0] > LEVELS).sum(),), "x", [0.0],
        1.0 + (np.diff([0.0, *LEVELS]) / np.arange(1.0, 21.0)).sum(), end=[LEVELS[-1] + 21.0],
    ),
    "stairs that lead back": Hybrid(
        lambda s: (1.0 - 2 * (s[0] > LEVELS).sum(),), "x", [0.0], 1.0, status=Status.SLIDING,
        stop=0.25, is_smooth=False,
    ),
    "a table that leads back": Hybrid(
        lambda s: (np.interp(s[0], [0, 0], [1, -1]),), "x", [-1.0], 3.0, status=Status.SLIDING,
        stop=1.0, is_smooth=False,
    ),
    "a short slide": Hybrid(  # from 1 to 1.105, until z is 0.1
        lambda s: (np.where(s[0] > 0, -1, 0.1 - s[1]), np.where(s[0] > 0, 0, 1)), "y z", [1.0, 0.0],
        2.0, end=[-(0.895**2) / 2, 0.995], is_smooth=False,
    ),
    "a rest just at its edge": Hybrid(  # friction just holds the spring at x = mu
        friction, "x v", [1.0, 0.0], 20.0, end=[0.2, 0.0], parameters={"mu": 0.2}, is_smooth=False,
    ),
    "tables at infinity": Hybrid(  # log(0) and 1/0; y' = 2 to 1/2, 1 to 1, at t = 3/4, then 1/2
        lambda s: (np.interp(np.log(s[1]), [0.0, 1.0], [3.0, 5.0]),
                   np.interp(1 / s[1], [1.0, 2.0], [1.0, 1.0], left=0.5, right=2.0)),
        "x y", [0.0, 0.0], 1.0, end=[3.0 + 4.0 * (9 / 8 * log(9 / 8) - 1 / 8), 9 / 8],
        is_smooth=False,
    ),
    "rounding and a bend": Hybrid(
        lambda s, k: (k * np.floor(s[1]) - abs(s[0] - k), 1.0 + 0.1 * s[0]), "x y", [0.0, 0.5], 4.0,
        parameters={"k": 0.5},
    ),
    "a surface by a table": Hybrid(
        lambda s, a: (s[1], -s[0] - 0.1 * a * s[1] * np.where(
            s[0] > np.interp(s[1], [-1, 0, 0.4, 1], [1, 0.7, 0.2, -1]), 1, -1)),
        "q p", [1.5, 0.0], 6.0, parameters={"a": 1.3},
    ),
}  # fmt: skip

# Surfaces that are flat or jump where an oscillator passes 0.
for _name, _surface in {
    "flat below 0": lambda s: np.minimum(s[0], 0.0),
    "a sign": lambda s: np.sign(s[0]),
    "a floor": lambda s: np.floor(s[0] / 2.0),
    "a cube": lambda s: s[0] ** 3,
}.items():
    SYSTEMS[_name] = Hybrid(
        oscillator, "q p", [1.0, 0.0], 30.0, [Event(_surface)], [pi * SECTION[:10]],
        [np.cos(30.0), -np.sin(30.0)], digits=3e-8, is_smooth=False,
    )  # fmt: skip

# Surfaces of a clock that jump, also against their rate, or from 0 at the start.
for _name, (_surface, _direction, _times) in {
    "a wave of signs": (lambda s: np.sign(np.sin(3 * s[1])), 1, 2 * pi / 3 * np.arange(1, 5)),
    "a remainder": (lambda s: np.mod(s[1], 2) - 1, 0, np.arange(1, 9)),
    "a threshold that jumps": (lambda s: s[0] - np.where(s[1] < 4, 2, -4), 0, [1, 4, 7]),
    "an angle": (lambda s: np.arctan2(np.sin(3 * s[1]), np.cos(3 * s[1])) - 0.3, 0,
                 np.sort([*(0.1 + 2 * pi / 3 * np.arange(5)), *(pi / 3 * np.arange(1, 9, 2))])),
}.items():  # fmt: skip
    SYSTEMS[_name] = Hybrid(
        lambda s: (-1.0, 1.0), "x t", [3.0, 0.0], 8.6, [Event(_surface, direction=_direction)],
        [_times], [3.0 - 8.6, 8.6], is_smooth=False,
    )  # fmt: skip

# Changes to where the surface is 0 all around.
for _name, _surface in {
    "to a flat part": lambda s: np.minimum(s[0], 0),
    "to a step": lambda s: np.floor(s[0]),
}.items():
    SYSTEMS[_name] = Hybrid(
        lambda s: (-1.0,), "x", [1.0], 10.0,
        [Event(_surface, direction=-1, to=lambda s: (s[0] + 2,))], [[1.0, 3.0, 5.0, 7.0, 9.0]],
        [1.0], is_smooth=False,
    )  # fmt: skip

# A change of x over a jump or a kink of f, which goes on with the other choice.
for _name, _sign in {
    "a sign of f": np.sign,
    "a table of f": lambda x: np.interp(x, [-3, -2, 2, 3], [-1, -1, 1, 1]),
}.items():
    SYSTEMS[_name] = Hybrid(
        lambda s, sign=_sign: (-sign(s[0]), 0.0), "x n", [4.5, 0.0], 1.0,
        [Event(lambda s: np.abs(s[0]) - 4, direction=-1, to=lambda s: (-s[0] - 1, s[1] + 1))],
        [[0.5]], [-4.5, 1.0], is_smooth=False,
    )  # fmt: skip
