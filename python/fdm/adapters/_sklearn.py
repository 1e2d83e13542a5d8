"""scikit-learn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._model import Model
from .._run import Run, RunLike


def sklearn_estimator(model: Model, **options: Any) -> Any:
    """An estimator whose samples are runs: ``fit(runs)``, ``predict(runs)``, ``score(runs)``; cross-validation leaves runs out.

    options: those of `Model.fit`, which are the parameters of the estimator. The score is the mean R^2 of the outputs of runs that
    are predicted as `Fit.predict` does.

    ::

        cross_val_score(sklearn_estimator(m, fix=["a"]), np.array(runs, dtype=object), cv=LeaveOneOut())
    """
    from sklearn.base import BaseEstimator, RegressorMixin

    class Estimator(RegressorMixin, BaseEstimator):  # type: ignore[misc]
        def __init__(self, model: Model, options: dict[str, Any]):
            self.model, self.options = model, options

        def fit(self, X: Sequence[RunLike] | Sequence[Run], y: Any = None) -> Any:
            self.fit_ = self.model.fit(list(X), progress=False, **self.options)
            self.coef_ = np.array([p.value for p in self.fit_.params.values() if p.run is None])
            return self

        def predict(self, X: Sequence[RunLike]) -> list[Any]:
            return [h.response for h in self.fit_.predict(list(X), progress=False).histories]

        def score(self, X: Sequence[RunLike], y: Any = None) -> float:
            outputs = self.fit_.predict(list(X), progress=False).outputs
            return float(np.mean([o.r2 for o in outputs if o.get("r2") is not None]))

    return Estimator(model, options)
