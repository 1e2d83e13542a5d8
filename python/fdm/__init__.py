"""Find the mathematical model of a moving vehicle or a chemical reaction from measured data.

::

    import fdm

    m = fdm.Model("roll.fdm")                        # checked: names, units, every derivative
    fit = m.fit("run.csv")                           # a file, a frame, a dictionary of arrays, or several of them
    fit.params["d1"].value, fit.params["d1"].error   # the error holds for coloured residuals too
    fit.plot(); fit.report("roll.html"); fit.save("result")

Words, defaults and numbers are those of the command ``fdm``, to the bit. Long work releases the interpreter's lock, shows how far it is,
and ends at Ctrl-C with the best so far.

Models: `Model`, `model`, and the cell magic ``%%fdm`` (``%load_ext fdm``). Records: `Run`, `RunTable`, `Signal`, `doctor`. Results: `Fit`, `load`.
Many machines: `map`. Other packages: `fdm.adapters`. Mistakes: `Error` and what follows from it.
"""

from ._errors import (
    Error,
    Finding,
    InputError,
    InterruptedWarning,
    ModelError,
    ModelWarning,
    NumericalError,
    OptionError,
    Problem,
    RecordError,
    ResultWarning,
    RunError,
    SampleError,
    UnknownOption,
    UnreadableError,
)
from ._fdm import VERSION as __version__
from ._fdm import set_threads, threads
from ._fit import Fit, History, Parameter, Params, Prediction, load
from ._map import Mapped, map
from ._model import Channel, Model, Param, Residuals, Response
from ._notebook import load_ipython_extension, model
from ._progress import telling as progress
from ._results import Answer, Calibration, Check, Design, Diagnosis, Doctor, Draws, Effects, Linear, Margins, Modes, Profiles, Spectra, Study, doctor
from ._run import Run, RunTable, Signal

__all__ = [
    "Answer",
    "Calibration",
    "Channel",
    "Check",
    "Design",
    "Diagnosis",
    "Doctor",
    "Draws",
    "Effects",
    "Error",
    "Finding",
    "Fit",
    "History",
    "InputError",
    "InterruptedWarning",
    "Linear",
    "Mapped",
    "Margins",
    "Model",
    "ModelError",
    "ModelWarning",
    "Modes",
    "NumericalError",
    "OptionError",
    "Param",
    "Parameter",
    "Params",
    "Prediction",
    "Problem",
    "Profiles",
    "RecordError",
    "Residuals",
    "Response",
    "ResultWarning",
    "Run",
    "RunError",
    "SampleError",
    "RunTable",
    "Signal",
    "Spectra",
    "Study",
    "UnknownOption",
    "UnreadableError",
    "__version__",
    "doctor",
    "load",
    "load_ipython_extension",
    "map",
    "model",
    "progress",
    "set_threads",
    "threads",
]
