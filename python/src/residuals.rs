//! Residuals and their Jacobian, prepared once, written into arrays that Python gives or gets.

use crate::errors::{numbers, said};
use crate::model::Model;
use crate::records::{Record, all};
use fdm::simulate::Scheme;
use fdm::{FitOptions, ResidualVector};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray1, PyReadwriteArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

struct Owner {
    model: fdm::Model,
    runs: Vec<fdm::Run>,
}

self_cell::self_cell!(
    struct Prepared {
        owner: Owner,
        #[not_covariant]
        dependent: ResidualVector,
    }
);

/// What does not change.
struct Described {
    len: usize,
    names: Vec<(String, Option<String>, Option<String>)>,
    start: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    priors: Vec<Option<(f64, f64)>>,
    outputs: Vec<usize>,
}

/// Residuals of a model and runs.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Residuals {
    prepared: Mutex<Prepared>,
    described: Described,
}

#[pymethods]
impl Residuals {
    #[new]
    #[pyo3(signature = (model, records, deviations, steps=None, integrator=None))]
    fn new(
        py: Python<'_>,
        model: &Model,
        records: Vec<Py<Record>>,
        deviations: Vec<f64>,
        steps: Option<NonZeroUsize>,
        integrator: Option<&str>,
    ) -> PyResult<Self> {
        let scheme = match integrator {
            None | Some("auto") => None,
            Some("runge-kutta") => Some(Scheme::RungeKutta),
            Some("radau") => Some(Scheme::Radau),
            Some(other) => return Err(said(py, format!("there is no integrator `{other}`: auto, runge-kutta, radau"))),
        };
        let options = FitOptions { per_interval: steps.map(NonZeroUsize::get), scheme, ..FitOptions::default() };
        let runs = all(&records).into_iter().map(|r| r.run).collect();
        let owner = Owner { model: model.model.clone(), runs };
        let prepared = py.detach(|| {
            Prepared::try_new(owner, |own| ResidualVector::new(&own.model, &own.runs, &deviations, &options))
        });
        let prepared = prepared.map_err(|e| said(py, e))?;
        let described = prepared.with_dependent(|_, vector| {
            let (lower, upper) = vector.bounds();
            Described {
                len: vector.len(),
                names: vector.unknowns().into_iter().map(|n| (n.name, n.run, n.unit)).collect(),
                start: vector.start().to_vec(),
                lower: lower.to_vec(),
                upper: upper.to_vec(),
                priors: vector.priors().into_iter().map(|p| p.map(|p| (p.mean, p.deviation))).collect(),
                outputs: vector.outputs().collect(),
            }
        });
        Ok(Self { prepared: Mutex::new(prepared), described })
    }

    /// Number of residuals R.
    fn __len__(&self) -> usize {
        self.described.len
    }

    /// Name, run and unit of each unknown (U).
    #[getter]
    fn names(&self) -> Vec<(String, Option<String>, Option<String>)> {
        self.described.names.clone()
    }

    /// Start value of each unknown (U).
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.described.start)
    }

    /// Least and greatest value of each unknown (U each).
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray1<f64>>; 2] {
        [&self.described.lower, &self.described.upper].map(|bound| PyArray1::from_slice(py, bound))
    }

    /// Mean and deviation of what is known beforehand of each unknown (U).
    #[getter]
    fn priors(&self) -> Vec<Option<(f64, f64)>> {
        self.described.priors.clone()
    }

    /// The output that each residual (R) belongs to, by its number.
    #[getter]
    fn outputs<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        PyArray1::from_slice(py, &self.described.outputs)
    }

    /// Residuals (R) at these values of the unknowns (U).
    #[pyo3(signature = (values, out=None))]
    fn residuals<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray1<'py, f64>,
        out: Option<Bound<'py, PyArray1<f64>>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let residuals = out.unwrap_or_else(|| PyArray1::zeros(py, [self.described.len], false));
        {
            let mut into: PyReadwriteArray1<'_, f64> = residuals.try_readwrite()?;
            let (values, into) = (values.as_slice()?, into.as_slice_mut()?);
            self.fits(values.len(), into.len(), None)?;
            self.evaluated(py, |vector| vector.residuals(values, into))?;
        }
        Ok(residuals)
    }

    /// Residuals (R) and their Jacobian (R by U) at these values of the unknowns (U).
    #[pyo3(signature = (values, out=None))]
    #[expect(clippy::type_complexity, reason = "the pair that Python gets")]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray1<'py, f64>,
        out: Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (len, unknowns) = (self.described.len, self.described.names.len());
        let (residuals, jacobian) =
            out.unwrap_or_else(|| (PyArray1::zeros(py, [len], false), PyArray2::zeros(py, [len, unknowns], false)));
        {
            let mut r: PyReadwriteArray1<'_, f64> = residuals.try_readwrite()?;
            let mut j: PyReadwriteArray2<'_, f64> = jacobian.try_readwrite()?;
            // numbers are written row by row, which in another order would stand in other places
            if !jacobian.is_c_contiguous() || jacobian.shape() != [len, unknowns] {
                return Err(PyValueError::new_err(format!(
                    "the Jacobian in `out` has the shape {:?}, expected ({len}, {unknowns}) row by row in one piece (C order)",
                    jacobian.shape()
                )));
            }
            let (values, r, j) = (values.as_slice()?, r.as_slice_mut()?, j.as_slice_mut()?);
            self.fits(values.len(), r.len(), Some(j.len()))?;
            self.evaluated(py, |vector| vector.jacobian(values, r, j))?;
        }
        Ok((residuals, jacobian))
    }
}

impl Residuals {
    fn fits(&self, values: usize, residuals: usize, jacobian: Option<usize>) -> PyResult<()> {
        let (len, unknowns) = (self.described.len, self.described.names.len());
        let wrong = |what: &str, found: usize, expected: usize| {
            (found != expected).then(|| PyValueError::new_err(format!("{found} {what}, expected {expected}")))
        };
        let found = wrong("parameters", values, unknowns)
            .or_else(|| wrong("residuals in `out`", residuals, len))
            .or_else(|| wrong("numbers of the Jacobian in `out`", jacobian?, len * unknowns));
        found.map_or(Ok(()), Err)
    }

    fn evaluated(
        &self,
        py: Python<'_>,
        evaluate: impl FnOnce(&mut ResidualVector<'_>) -> Result<(), fdm::simulate::Divergence> + Send,
    ) -> PyResult<()> {
        let found = py.detach(|| {
            let mut prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
            prepared.with_dependent_mut(|_, vector| evaluate(vector))
        });
        found.map_err(|d| numbers(py, format!("the simulation is not finite at time {}", d.time)))
    }
}
