//! What a vehicle needs to follow its own parameters in flight: the equations, and by what the recursion is weighed and begun, which
//! records on the ground have told ([`RecursiveEstimator`]). It takes the same steps as [`recursive()`](super::recursive()).

use super::equations::{Equation, Equations, Left};
use super::error::RegressionError;
use super::fit::completed;
use super::recursive::{Filter, Iterate, RecursiveOptions, followed, sized, steps_of};
use super::regression::Unknown;
use fdm_grammar::graph::{Leaf, Node, Signal};
use fdm_grammar::op::ExprId;
use fdm_grammar::schedule::{Program, program};
use fdm_system::Model;
use fdm_system::record::Run;

/// By what a recursion is weighed and begun.
#[derive(Debug, Clone, PartialEq)]
pub struct RecursiveConstants {
    /// Weight of a step relative to the one behind it, above 0, at most 1.
    pub forgetting: f64,
    /// One over the residual of each equation; 0 of one that is not used.
    pub weights: Vec<f64>,
    /// Parameters that are estimated together.
    pub groups: Vec<ParameterGroup>,
    /// Inputs, hidden ones included, that keep their value until the next sample.
    pub held: Vec<bool>,
    /// Shortest interval between the samples of the records.
    pub interval: f64,
}

/// Parameters of equations that share some.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterGroup {
    /// By index, rising.
    pub params: Vec<u32>,
    /// Root mean square of the weighted column of each.
    pub scale: Vec<f64>,
    /// Standard deviation at the beginning of each value times its scale, where residuals are 1.
    pub open: f64,
}

/// A recursion that is ready for samples.
#[derive(Debug, Clone)]
pub struct RecursiveEstimator {
    model: Model,
    equations: Equations,
    constants: RecursiveConstants,
}

/// An equation `(x(k+1) - x(k))/dt = mean of both ends of (known + sum parameter*column)`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EstimatorEquation {
    /// `der(x)`.
    pub name: String,
    /// The state, by index.
    pub state: usize,
    /// The parameters of its columns, by index, rising.
    pub params: Vec<u32>,
}

impl RecursiveEstimator {
    /// Weighed and scaled by records; a `per run` parameter becomes one of the flight.
    ///
    /// # Errors
    /// [`RegressionError`] as [`recursive()`](super::recursive()).
    pub fn of(model: &Model, runs: &[Run], forgetting: f64) -> Result<Self, RegressionError> {
        if runs.is_empty() {
            return Err(RegressionError::NoRuns);
        }
        let equations = usable(model, forgetting)?;
        let definition = model.definition();
        let runs = completed(definition, runs)?;
        let (_, filters) = sized(definition, &equations, &runs)?;
        if filters.is_empty() {
            let names: Vec<String> = (0..equations.equations.len()).map(|k| equations.name(definition, k)).collect();
            return Err(RegressionError::NoRows { equations: names.join(", ") });
        }
        let mut weights = vec![0.0; equations.equations.len()];
        filters.iter().flat_map(|f| &f.weights).for_each(|(equation, weight)| weights[*equation] = *weight);
        let steps = runs.iter().flat_map(|run| run.time.windows(2).map(|w| w[1] - w[0]));
        let constants = RecursiveConstants {
            forgetting,
            weights,
            groups: filters.iter().map(ParameterGroup::of).collect(),
            held: runs[0].held.clone(),
            interval: steps.fold(f64::INFINITY, f64::min),
        };
        Ok(Self { model: model.clone(), equations, constants })
    }

    /// With constants that were told before.
    ///
    /// # Errors
    /// [`RegressionError`] where no equation is a regression, or the forgetting is none.
    ///
    /// # Panics
    /// When there are not as many weights as equations, or scales as parameters.
    pub fn with(model: &Model, constants: RecursiveConstants) -> Result<Self, RegressionError> {
        let equations = usable(model, constants.forgetting)?;
        assert_eq!(constants.weights.len(), equations.equations.len(), "a weight for each equation");
        assert!(constants.groups.iter().all(|g| g.params.len() == g.scale.len()), "a scale for each parameter");
        Ok(Self { model: model.clone(), equations, constants })
    }

    /// How many equations a model has that are regressions.
    ///
    /// # Errors
    /// [`RegressionError`] where there is none.
    pub fn equation_count(model: &Model) -> Result<usize, RegressionError> {
        Ok(usable(model, 1.0)?.equations.len())
    }

    /// The constants.
    pub fn constants(&self) -> &RecursiveConstants {
        &self.constants
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The equations in their order.
    pub fn equations(&self) -> Vec<EstimatorEquation> {
        let one = |(k, e): (usize, &Equation)| {
            let Left::Rate(state) = e.left else { return None };
            let name = self.equations.name(self.model.definition(), k);
            Some(EstimatorEquation { name, state, params: e.columns.iter().map(|(param, _)| *param).collect() })
        };
        self.equations.equations.iter().enumerate().filter_map(one).collect()
    }

    /// Of each equation the known part and its columns, one behind the other; `known` are the parameters themselves.
    pub fn program(&self) -> Program {
        program(&self.equations.graph, &self.roots(), self.model.layout().inputs)
    }

    fn roots(&self) -> Vec<ExprId> {
        let of = |e: &Equation| std::iter::once(e.known).chain(e.columns.iter().map(|(_, c)| *c)).collect::<Vec<_>>();
        self.equations.equations.iter().flat_map(of).collect()
    }

    /// How each state is read from an output, `(output, slope, offset)` with `output = slope*state + offset`; none where no output
    /// shows it.
    pub fn readings(&self) -> Vec<Option<(usize, f64, f64)>> {
        let readings = self.equations.readings.iter();
        readings.map(|r| r.as_ref().map(|r| (r.output, self.value(r.slope), self.value(r.offset)))).collect()
    }

    /// An expression of parameters; NaN where a run brings one of them.
    fn value(&self, e: ExprId) -> f64 {
        let params = &self.model.definition().params;
        self.equations.graph.evaluate(e, |leaf| match leaf {
            Leaf::Param(k) if !params[k as usize].is_recorded() => params[k as usize].value,
            _ => f64::NAN,
        })
    }

    /// Delayed signals that the equations read: place among all delayed signals, what is delayed, and by how much.
    pub fn delays(&self) -> Vec<(usize, Signal, f64)> {
        let graph = &self.equations.graph;
        let read = graph.reachable(self.roots()).into_iter().filter_map(|e| match graph.node(e) {
            Node::Leaf(Leaf::Delayed(k)) => Some(k as usize),
            _ => None,
        });
        let mut read: Vec<usize> = read.collect();
        read.sort_unstable();
        read.dedup();
        let one = |k: usize| (k, graph.delayed()[k].signal, self.value(graph.delayed()[k].tau));
        read.into_iter().map(one).collect()
    }

    /// All delayed signals of the program's drive, read or not.
    pub fn delayed_count(&self) -> usize {
        self.equations.graph.delayed().len()
    }

    /// Inputs that the equations read as derivatives of others, by index.
    pub fn derivatives(&self) -> Vec<usize> {
        let (graph, inputs) = (&self.equations.graph, &self.model.definition().inputs);
        let read = graph.reachable(self.roots()).into_iter().filter_map(|e| match graph.node(e) {
            Node::Leaf(Leaf::Input(k)) => Some(k as usize),
            _ => None,
        });
        let delayed = self.delays().into_iter().filter_map(|(_, signal, _)| match signal {
            Signal::Input(k) => Some(k as usize),
            Signal::State(_) => None,
        });
        read.chain(delayed).filter(|k| inputs[*k].slope.is_some() || inputs[*k].computed.is_some()).collect()
    }

    /// Follows the parameters along one run, from the model's values on; values in the order of the groups and their parameters.
    /// One-step errors are those of no record, and zero.
    ///
    /// # Errors
    /// [`RegressionError`] where the run does not serve.
    pub fn follow(&self, run: &Run) -> Result<Vec<Iterate>, RegressionError> {
        let definition = self.model.definition();
        let runs = completed(definition, std::slice::from_ref(run))?;
        let stretches = steps_of(definition, &self.equations, &runs[0], 0)?;
        let filter = |group: &ParameterGroup| {
            let own = |param: u32| definition.params[param as usize].per_run.then_some(0);
            let unknowns = group.params.iter().map(|k| Unknown { param: *k, run: own(*k) }).collect();
            let weights = self.constants.weights.iter().copied().enumerate().collect();
            let mut filter = Filter::of(unknowns, weights, group.scale.clone());
            filter.begin(definition, group.open);
            filter
        };
        let mut filters: Vec<Filter> = self.constants.groups.iter().map(filter).collect();
        Ok(followed(&mut filters, &stretches, &runs, self.constants.forgetting))
    }
}

/// The equations that are regressions.
fn usable(model: &Model, forgetting: f64) -> Result<Equations, RegressionError> {
    RecursiveOptions { forgetting, ..RecursiveOptions::default() }.check(model)?;
    let equations = Equations::of_rates(model.definition());
    if equations.equations.is_empty() { Err(RegressionError::NoEquation(equations.refused)) } else { Ok(equations) }
}

impl ParameterGroup {
    /// Values of single runs become one, whose column is as large as theirs together.
    fn of(filter: &Filter) -> Self {
        let mut params: Vec<u32> = filter.unknowns.iter().map(|u| u.param).collect();
        params.dedup();
        let scale = |param: &u32| {
            let own = || filter.unknowns.iter().zip(&filter.scale).filter(|(u, _)| u.param == *param).map(|(_, s)| *s);
            match own().count() {
                1 => own().sum::<f64>(),
                runs => (own().map(|s| s * s).sum::<f64>() / runs as f64).sqrt(),
            }
        };
        Self { scale: params.iter().map(scale).collect(), open: filter.open, params }
    }
}
