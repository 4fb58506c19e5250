"""Laws of every shape that the export knows, and what it takes to compile them."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polefence.export.program import Program, number, program
from polefence.export.sources import Texts, sources
from polefence.law.laws import FixedGain, Law, PolynomialGain, ScheduledGain
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from support.paths import ROOT

FUZZ = ROOT / "tests" / "export" / "fuzz"
WARNINGS = (
    "all extra pedantic conversion sign-conversion double-promotion shadow cast-qual "
    "strict-prototypes undef error"
)
STRICT = ["-std=c99", "-O2", *(f"-W{each}" for each in WARNINGS.split())]
SANITIZERS = "address,undefined,float-divide-by-zero"
SANITIZED = ["-std=c99", "-O0", f"-fsanitize={SANITIZERS}", "-fno-sanitize-recover=all"]

M1 = Parameter("m1", "231.12", "346.68", "kg", "1/m1")
BETA = Parameter("beta", -10, 10)
LEFT = Parameter("left", -3, "-0.7", "m", "1/left")  # inverted, below zero


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, timeout=120, check=False
    )


@dataclass(frozen=True)
class Shape:
    """One law and its export."""

    label: str
    n: int
    m: int
    sizes: tuple[int, ...] = ()  # none: a fixed gain
    degree: int = 1
    parameters: tuple[Parameter, ...] = ()
    bits: int = 32
    limits: tuple[float, ...] = ()
    powers: tuple[tuple[int, ...], ...] = ()  # a polynomial
    measured: bool = False

    @property
    def _random(self) -> np.random.Generator:
        return np.random.default_rng([ord(c) for c in self.label])

    @property
    def units(self) -> np.ndarray:
        """Sizes of the states."""
        return 10.0 ** self._random.uniform(-3, 3, self.n)

    @property
    def law(self) -> Law:
        random, units = self._random.spawn(1)[0], self.units
        K = random.normal(size=(self.m, self.n))
        if self.powers:
            each = [K, *(0.2 * random.normal(size=(len(self.powers) - 1, *K.shape)))]
            rows = enumerate(np.eye(self.n)) if self.measured else ()
            y = tuple(Output(f"signal {k}", "m", row.tolist()) for k, row in rows)
            return PolynomialGain(self.powers, np.array(each) / units, y, self.parameters)
        if not self.sizes:
            return FixedGain(K / units)
        W, Z = [], []
        for _ in range(Domain(self.sizes).count(self.degree)):
            root = np.eye(self.n) + 0.2 * random.normal(size=(self.n, self.n))
            W.append(root @ root.T * np.outer(units, units))
            Z.append((K + 0.2 * random.normal(size=K.shape)) @ root @ root.T * units)
        return ScheduledGain(np.array(W), np.array(Z), self.parameters, self.degree, self.sizes)

    @property
    def program(self) -> Program:
        return program(self.law, self.parameters, number(self.bits))

    @property
    def texts(self) -> Texts:
        states = tuple(f"state {i} [m]" for i in range(self.n))
        inputs = tuple(f"force {i} [N]" for i in range(self.m))
        return Texts("law", self.label, ("A statement.",), states, inputs, self.limits)

    def sources(self) -> dict[str, str]:
        return sources(self.program, self.texts)

    def write(self, folder: Path) -> Path:
        """Write the sources, and beside them the bounds that the fuzz driver is to expect."""
        folder.mkdir(parents=True, exist_ok=True)
        files = self.sources() | {"bounds.h": self.bounds()}
        for name, text in files.items():
            (folder / name).write_text(text)
        return folder

    def bounds(self) -> str:
        text = number(self.bits).text
        shares = getattr(self.program, "shares", ())
        lists = {
            "LOW": [text(s.low) for s in shares],
            "HIGH": [text(s.high) for s in shares],
            "LIMITS": [repr(v) for v in self.limits],
        }
        lines = [f"#define {key} {{ {', '.join(v)} }}" for key, v in lists.items() if v]
        return "\n".join(lines) + "\n"


AFFINE = ((0, 0), (1, 0), (0, 1))
SHAPES = [
    Shape("fixed, one input", 5, 1),
    Shape("fixed, two inputs with limits, double", 4, 2, bits=64, limits=(2.0, 0.7)),
    Shape("fixed, one state, two inputs", 1, 2),
    Shape("two parameters", 5, 1, (4,), parameters=(M1, BETA)),
    Shape("two parameters, double", 5, 1, (4,), parameters=(M1, BETA), bits=64),
    Shape("two parameters, limits", 5, 2, (4,), parameters=(M1, BETA), limits=(2.0, 0.7)),
    Shape("one parameter", 3, 2, (2,), parameters=(LEFT,)),
    Shape("one parameter, one state", 1, 1, (2,), parameters=(M1,)),
    Shape("one parameter, degree 2, double", 2, 1, (2,), 2, (BETA,), 64),
    Shape("alpha of three", 4, 1, (3,)),
    Shape("alpha of four, limits, double", 4, 2, (4,), bits=64, limits=(2.0, 0.7)),
    Shape("alpha of one vertex", 2, 1, (1,)),
    Shape("degree 2 on the box", 5, 1, (2, 2), 2, (M1, BETA)),
    Shape("degree 2 on the box, alpha, double", 3, 1, (2, 2), 2, bits=64),
    Shape("degree 2 on the simplex", 3, 2, (4,), 2, (M1, LEFT), 32, (2.0, 0.7)),
    Shape("degree 2 on the simplex, alpha", 3, 1, (3,), 2),
    Shape("three parameters", 6, 2, (8,), parameters=(M1, BETA, LEFT)),
    Shape("three parameters on the box, double", 3, 1, (2, 2, 2), 1, (M1, BETA, LEFT), 64),
    Shape("polynomial", 4, 1, (2, 2), 1, (M1, BETA), powers=((0, 0), (1, 0), (0, 2), (1, 1))),
    Shape(
        "polynomial of signals, limits", 3, 2, (2, 2), 1, (M1, LEFT), 32, (2.0, 0.7), AFFINE, True
    ),
    Shape("polynomial of one signal, double", 1, 1, (2,), 1, (BETA,), 64, (), ((0,), (3,)), True),
    Shape("polynomial of alpha", 3, 1, (3,), powers=((2, 0, 0), (0, 2, 0), (1, 0, 1)), bits=64),
    Shape("one gain of signals", 3, 1, powers=((0,),), measured=True),
]
BY_LABEL = {shape.label: shape for shape in SHAPES}


def weights(values: np.ndarray, parameters) -> np.ndarray:
    """Return alpha of the parameters, by the definition: first parameter slowest."""
    alpha = np.ones((len(values), 1))
    for p, value in zip(parameters, values.T, strict=True):
        low, high = float(p.low), float(p.high)
        if p.inverted:
            low, high, value = 1 / low, 1 / high, 1 / value
        share = np.clip((value - low) / (high - low), 0, 1)
        pair = np.stack([1 - share, share], axis=1)
        alpha = (alpha[:, :, None] * pair[:, None, :]).reshape(len(values), -1)
    return alpha
