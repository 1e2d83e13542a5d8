//! A checked model: what it declares, and what can be asked of it without records.

use crate::errors::{findings, model as refused_model, refused, said};
use crate::records::{Record, Source};
use fdm::grammar::graph::Signal;
use fdm::linear::Values;
use fdm::request::{self, Answer as Told};
use fdm::{LinearModel, Modes};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Files of a result: names and contents.
pub(crate) type Files = Vec<(String, Vec<u8>)>;

/// What makes a model again.
#[derive(FromPyObject, IntoPyObject)]
struct State {
    #[pyo3(item)]
    name: String,
    #[pyo3(item)]
    text: String,
    #[pyo3(item)]
    used: Vec<String>,
    #[pyo3(item)]
    groups: BTreeMap<String, Vec<String>>,
    #[pyo3(item)]
    untied: Vec<String>,
    #[pyo3(item)]
    set: Vec<(String, f64)>,
    #[pyo3(item)]
    fix: Vec<String>,
    #[pyo3(item)]
    free: Vec<String>,
}

/// A checked and compiled model.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Model {
    pub(crate) model: fdm::Model,
}

/// What was worked out: text, JSON, files, and whether all is well.
#[pyclass(frozen, get_all, module = "fdm._fdm")]
pub(crate) struct Answer {
    text: String,
    json: String,
    good: bool,
    interrupted: bool,
    files: Vec<(String, Py<PyBytes>)>,
}

impl Answer {
    pub(crate) fn new(py: Python<'_>, told: Told, interrupted: bool) -> Self {
        let Told { text, json, files, good, .. } = told;
        let files = files.into_iter().map(|(name, content)| (name, PyBytes::new(py, &content).unbind())).collect();
        Self { text, json: json.unwrap_or_default(), good, interrupted, files }
    }
}

/// Channels of a run: name, unit and samples (N).
type Channels<'py> = Vec<(String, Option<String>, PyReadonlyArray1<'py, f64>)>;

/// Inputs that a run holds between samples, those that go in straight lines, and where it begins.
#[derive(FromPyObject)]
struct Course(Vec<String>, Vec<String>, Option<f64>);

#[pymethods]
impl Model {
    /// Reads a file and those that it uses.
    #[staticmethod]
    fn from_file(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py.detach(|| fdm::Model::from_file(path));
        model.map(|model| Self { model }).map_err(|e| refused_model(py, &e))
    }

    /// Compiles a text; messages call it `name`.
    #[staticmethod]
    fn from_text(py: Python<'_>, name: String, text: String) -> PyResult<Self> {
        let model = py.detach(|| fdm::Model::from_text(name, text));
        model.map(|model| Self { model }).map_err(|e| refused_model(py, &e))
    }

    /// The model of a result.
    #[staticmethod]
    fn from_files(py: Python<'_>, files: Files) -> PyResult<Self> {
        let model = py.detach(|| request::model_of(&files));
        model.map(|model| Self { model }).map_err(|e| refused(py, e))
    }

    /// What makes the same model again: name and texts, ties that are off, and value, fixed and freed parameters.
    fn state(&self) -> State {
        let texts = self.model.source().texts();
        let used = texts.iter().skip(1).map(|t| t.text().to_string()).collect();
        let params = &self.model.definition().params;
        State {
            name: self.model.source().name().into(),
            text: texts.first().map_or(String::new(), |t| t.text().to_string()),
            used,
            groups: self.model.source().groups().clone(),
            untied: self.model.open_ties(),
            set: params.iter().filter(|p| !p.is_recorded()).map(|p| (p.quantity.name.clone(), p.value)).collect(),
            fix: params.iter().filter(|p| p.fixed && !p.is_recorded()).map(|p| p.quantity.name.clone()).collect(),
            free: params.iter().filter(|p| !p.fixed && !p.is_recorded()).map(|p| p.quantity.name.clone()).collect(),
        }
    }

    /// The model of a state.
    #[staticmethod]
    fn from_state(py: Python<'_>, state: State) -> PyResult<Self> {
        let State { name, text, used, groups, untied, set, fix, free } = state;
        let model = py.detach(|| fdm::Model::from_texts(name, text, &used)?.grouped(groups));
        let model = model.map_err(|e| refused_model(py, &e))?;
        let model = model.untied(&untied).map_err(|e| said(py, e))?;
        let params = &model.definition().params;
        let is = |name: &String, fixed: bool| params.iter().any(|p| p.quantity.name == *name && p.fixed == fixed);
        let fix = fix.into_iter().filter(|name| is(name, false)).collect();
        let free = free.into_iter().filter(|name| is(name, true)).collect();
        let changes = fdm::Changes { set, fix, free };
        let model = fdm::estimate::changed(&model, &changes).map_err(|e| said(py, e))?;
        Ok(Self { model })
    }

    /// This model with ties switched off.
    fn untied(&self, py: Python<'_>, names: Vec<String>) -> PyResult<Self> {
        let model = py.detach(|| self.model.untied(&names));
        model.map(|model| Self { model }).map_err(|e| said(py, e))
    }

    /// This model with other values, fixed and freed parameters.
    fn changed(&self, py: Python<'_>, set: Vec<(String, f64)>, fix: Vec<String>, free: Vec<String>) -> PyResult<Self> {
        let changes = fdm::Changes { set, fix, free };
        let model = py.detach(|| fdm::estimate::changed(&self.model, &changes));
        model.map(|model| Self { model }).map_err(|e| said(py, e))
    }

    /// Its own name.
    #[getter]
    fn name(&self) -> &str {
        self.model.name()
    }

    /// Its doc string.
    #[getter]
    fn doc(&self) -> &str {
        &self.model.definition().doc
    }

    /// The text.
    #[getter]
    fn text(&self) -> &str {
        self.model.source().text()
    }

    /// What messages call the text.
    #[getter]
    fn file(&self) -> &str {
        self.model.source().name()
    }

    /// The unit of time.
    #[getter]
    fn time_unit(&self) -> String {
        self.model.definition().time.to_string()
    }

    /// Findings that did not stop the compilation, and the same as they are printed.
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyList>, String)> {
        let (source, found) = (self.model.source(), self.model.warnings());
        let text = if found.is_empty() { String::new() } else { fdm::report::render(source, found, false) };
        Ok((findings(py, source, found)?, text))
    }

    /// Inputs, values that runs bring, states and outputs: name, doc and unit of each; hidden inputs and groups are left out.
    fn channels(&self) -> [Vec<(String, String, Option<String>)>; 4] {
        let d = self.model.definition();
        let one = |q: &fdm::grammar::model::Quantity| {
            (q.name.clone(), q.doc.clone(), q.unit.as_ref().map(ToString::to_string))
        };
        [
            d.inputs.iter().filter(|i| i.is_declared() && !i.known).map(|i| one(&i.quantity)).collect(),
            // a group is a value that is 1 in its runs
            d.inputs.iter().filter(|i| i.known && i.membership.is_none()).map(|i| one(&i.quantity)).collect(),
            d.states.iter().map(|s| one(&s.quantity)).collect(),
            d.outputs.iter().map(|o| one(&o.quantity)).collect(),
        ]
    }

    /// Parameters in the model's order.
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let d = self.model.definition();
        let declared = d.params.iter().filter(|p| !p.is_recorded());
        declared
            .map(|p| {
                let dict = PyDict::new(py);
                dict.set_item("name", &p.quantity.name)?;
                dict.set_item("doc", &p.quantity.doc)?;
                dict.set_item("unit", p.quantity.unit.as_ref().map(ToString::to_string))?;
                dict.set_item("value", p.value)?;
                dict.set_item("lower", p.lower)?;
                dict.set_item("upper", p.upper)?;
                dict.set_item("fixed", p.fixed)?;
                dict.set_item("per_run", p.per_run)?;
                dict.set_item("log", p.logarithmic)?;
                dict.set_item("prior", p.prior.map(|prior| (prior.mean, prior.deviation)))?;
                Ok(dict)
            })
            .collect()
    }

    /// Declared standard deviation of the noise of each output (q).
    fn noise(&self) -> Vec<Option<f64>> {
        self.model.definition().outputs.iter().map(|o| o.noise).collect()
    }

    /// A run from samples in memory: name, unit and samples of each channel, and the groups that it belongs to; the times are called `t`.
    fn run(
        &self,
        py: Python<'_>,
        name: String,
        channels: Channels<'_>,
        groups: BTreeMap<String, String>,
        course: Course,
        without_outputs: bool,
    ) -> PyResult<Record> {
        let Course(hold, linear, begin) = course;
        let mut builder = self.model.run(name);
        for (grouping, group) in &groups {
            builder = builder.group(grouping, group);
        }
        for (channel, unit, samples) in &channels {
            let unit = unit.as_deref();
            builder = match (samples.as_slice(), samples.try_as_matrix()) {
                (Ok(samples), _) => builder.samples_of(channel, unit, samples),
                (Err(_), Some(column)) => builder.samples_of_column(channel, unit, column),
                // backwards in memory
                (Err(_), None) => {
                    let samples: Vec<f64> = samples.as_array().iter().copied().collect();
                    match unit {
                        Some(unit) => builder.samples_in(channel, unit, samples),
                        None => builder.samples(channel, samples),
                    }
                }
            };
        }
        for input in hold {
            builder = builder.zero_order_hold(&input);
        }
        for input in linear {
            builder = builder.linear(&input);
        }
        if without_outputs {
            builder = builder.without_outputs();
        }
        if let Some(begin) = begin {
            builder = builder.begin(begin);
        }
        let run = py.detach(|| builder.build()).map_err(|e| crate::errors::run(py, &e))?;
        Ok(Record { record: request::Record::in_memory(run) })
    }

    /// The files that the command would read with these options, and how.
    fn sources(
        &self,
        py: Python<'_>,
        files: Vec<PathBuf>,
        words: Vec<String>,
        to_simulate: bool,
    ) -> PyResult<Vec<Source>> {
        let found = py.detach(|| request::sources(&self.model, &files, &words, to_simulate));
        let found = found.map_err(|e| refused(py, e))?;
        Ok(found.into_iter().map(|source| Source { source }).collect())
    }

    /// Runs from files, and what a careful reader would mention of each.
    fn read(
        &self,
        py: Python<'_>,
        sources: Vec<Py<Source>>,
        elsewhere: Vec<bool>,
    ) -> PyResult<Vec<(Record, Vec<String>)>> {
        let sources: Vec<request::Source> = sources.iter().map(|s| s.get().source.clone()).collect();
        let read = py.detach(|| request::read(&self.model, &sources, &elsewhere)).map_err(|e| refused(py, e))?;
        Ok(read.into_iter().map(|(record, notes)| (Record { record }, notes)).collect())
    }

    /// Names of the groupings that parameters are shared within (`param k per group aircraft;`).
    fn groupings(&self) -> Vec<String> {
        self.model.groupings().into_iter().map(String::from).collect()
    }

    /// The groups that it is made for, by grouping; none before it is made for some.
    fn groups(&self) -> BTreeMap<String, Vec<String>> {
        self.model.source().groups().clone()
    }

    /// This model for groups by grouping: a parameter of each, such as `k[A]`.
    fn grouped(&self, py: Python<'_>, groups: BTreeMap<String, Vec<String>>) -> PyResult<Self> {
        let model = py.detach(|| self.model.grouped(groups));
        model.map(|model| Self { model }).map_err(|e| refused_model(py, &e))
    }

    /// `fdm check`.
    fn check(&self, py: Python<'_>) -> PyResult<Answer> {
        self.told(py, request::check)
    }

    /// `fdm effects`.
    fn effects(&self, py: Python<'_>, words: Vec<String>) -> PyResult<Answer> {
        self.told(py, |model| request::effects(model, &words))
    }

    /// `fdm extend`: the extended text, and what changes.
    fn extend(&self, py: Python<'_>, words: Vec<String>) -> PyResult<(String, String)> {
        py.detach(|| request::extend(&self.model, &words)).map_err(|e| refused(py, e))
    }

    /// `fdm modes`.
    fn modes(&self, py: Python<'_>) -> PyResult<Answer> {
        self.told(py, request::modes)
    }

    /// The linear model at the values of the parameters, linearised at its trim: matrices A (n by n), B (n by m), C (q by n), D (q by m),
    /// the delays of what follows, and where it was linearised.
    fn linear<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let definition = self.model.definition();
        let theta = definition.start();
        let mut linear = LinearModel::new(&self.model).map_err(|e| said(py, e))?;
        let mut values = Values::default();
        linear.evaluate(&theta, &mut values).map_err(|e| said(py, e))?;
        let trim = linear.trim(&theta);
        let structure = linear.structure();
        let (n, m, q) = (structure.states, structure.inputs, structure.outputs);
        let delayed = structure.delayed.len();
        let zeros = |rows, columns| PyArray2::<f64>::zeros(py, [rows, columns], false);
        let (whole, rows) = (zeros(n + q, n + m + delayed), n + q);
        {
            let mut whole = whole.readwrite();
            let numbers = whole.as_slice_mut()?;
            for (term, value) in structure.terms.iter().zip(&values.terms).filter(|(t, _)| (t.row as usize) < rows) {
                numbers[term.row as usize * (n + m + delayed) + term.signal as usize] = *value;
            }
        }
        let of = |signal: &Signal| match *signal {
            Signal::State(k) => definition.states[k as usize].quantity.name.clone(),
            Signal::Input(k) => definition.inputs[k as usize].quantity.name.clone(),
        };
        let dict = PyDict::new(py);
        dict.set_item("matrix", whole)?;
        dict.set_item("sizes", (n, m, q))?;
        dict.set_item("delayed", structure.delayed.iter().map(of).collect::<Vec<_>>())?;
        dict.set_item("delays", PyArray1::from_slice(py, &values.tau))?;
        dict.set_item("inputs", definition.inputs.iter().map(|i| i.quantity.name.clone()).collect::<Vec<_>>())?;
        dict.set_item("trim_states", PyArray1::from_slice(py, &trim.states))?;
        dict.set_item("trim_inputs", PyArray1::from_slice(py, &trim.inputs))?;
        let modes = Modes::new(structure, &values).map_err(|e| said(py, e))?;
        let poles: Vec<(f64, f64)> = modes.modes.iter().map(|mode| (mode.s.re, mode.s.im)).collect();
        dict.set_item("poles", poles)?;
        Ok(dict)
    }
}

impl Model {
    fn told(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&fdm::Model) -> Result<Told, request::Failure> + Send,
    ) -> PyResult<Answer> {
        let told = py.detach(|| ask(&self.model)).map_err(|e| refused(py, e))?;
        Ok(Answer::new(py, told, false))
    }
}
