"""Small plants as specification texts, and white noise of intensity 1 for bounds on them."""

from polefence.examples import spec_text
from polefence.requirements.rms import Rms

DENSITY = 2.0  # one-sided, of two-sided intensity 1

# x' = a x + u + w
ONE_STATE = """
name = "one state"
states = ["x [m]"]
inputs = ["force [N]"]
disturbances = ["w [m/s]"]
[parameter.a]
range = [0.5, 2]
[matrices]
A = [["a"]]
B = [[1]]
E = [[1]]
"""
# A body on a spring.
TWO_STATES = """
name = "two states"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["w [m/s2]"]
[parameter.m]
range = [0.8, 1.25]
through = "1/m"
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k/m", "-0.2/m"]]
B = [[0], ["1/m"]]
E = [[0], [1]]
"""
# A body on a spring, pushed by the input and the disturbance.
SPRING = """
name = "spring"
states = ["x [m]", "v [m/s]"]
inputs = ["f [N]"]
disturbances = ["w [N]"]
[parameter.m]
range = [0.8, 1.2]
unit = "kg"
through = "1/m"
[parameter.k]
range = [80, 120]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k/m", "-2/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
"""


def rms(signal, at_most=None):
    """Return the rms of a signal under white noise of intensity 1."""
    return Rms(signal, at_most, DENSITY)


def ride_of_loads():
    """Return the spec of the quarter car for its ride whose load alone is uncertain."""
    text = spec_text("quarter-car-ride").replace("[constants]", "[constants]\nbeta = 0")
    first, last = text.index("[parameter.beta]"), text.index("[definitions]")
    return text[:first] + text[last:]


# Another, lightly damped.
MASS_ON_SPRING = """
name = "mass on a spring"
states = ["position [m]", "velocity [m/s]"]
inputs = ["force [N]"]
disturbances = ["push [N]"]
[parameter.k]
range = [80, 120]
[matrices]
A = [[0, 1], ["-k", -2]]
B = [[0], [1]]
E = [[0], [1]]
"""
# v1 = (2 + p)/(s + 1) w2, v2 = (2 - p)/(s + 1) w1: of one plant the best scale leads to the root of
# the product, 2 at p = 0; one scale of all has 3, at both ends.
CROSSED = """
name = "crossed"
states = ["x1", "x2"]
inputs = ["u"]
disturbances = ["w1", "w2"]
[parameter.p]
range = [-1, 1]
[matrices]
A = [[-1, 0], [0, -1]]
B = [[1], [0]]
E = [[0, "2 + p"], ["2 - p", 0]]
[outputs]
"v1" = {C = [1, 0]}
"v2" = {C = [0, 1]}
"""

# Two inputs, two disturbances, two parameters.
TWO_MASSES = """
name = "two masses"
states = ["x1", "x2", "v1", "v2"]
inputs = ["u", "h"]
disturbances = ["w", "r"]
[parameter.k]
range = [0.8, 1.2]
[parameter.m]
range = [0.9, 1.1]
[matrices]
A = [[0, 0, 1, 0], [0, 0, 0, 1], ["-k", "0.5*k", "-0.4*m", 0.1], ["0.5*k", "-k", 0.1, -0.4]]
B = [[0, 0], [0, 0], [1, 0], [0, "m"]]
E = [[0, 0], [0, 0], [1, 0], [0, 0.5]]
"""
