"""Random vibration of a preloaded Hertzian contact that now and then loses contact.

>>> import vibroimpact as vi
>>> r = vi.run({"oscillator": {"zeta": 0.005, "h": 2e-3}})
>>> print(r["stationary"]["contact_loss_probability"])
0.0724556459545021 +- 1e-15

``scene``, ``Scene`` say what is to be computed, ``plan`` how that would be done, ``run`` does it. Everything is
dimensionless as in scene files: displacement q in 2/3 of the static compression, time in 1/Omega, force in the static
load; a scene with ``rig`` has its results in newtons, micrometres, hertz and seconds too.
"""

from ._errors import LimitError, SceneError, ToleranceWarning, VibroimpactError
from ._map import Map, map
from ._number import Curve, Number
from ._plan import Plan, Stage, plan
from ._results import Density, Results
from ._run import run
from ._scene import Scene, scene, scenes
from ._native import __version__

__all__ = [
    "Curve",
    "Density",
    "LimitError",
    "Map",
    "Number",
    "Plan",
    "Results",
    "Scene",
    "SceneError",
    "Stage",
    "ToleranceWarning",
    "VibroimpactError",
    "__version__",
    "map",
    "plan",
    "run",
    "scene",
    "scenes",
]
