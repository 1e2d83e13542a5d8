//! An estimator for a vehicle in flight as C: recursive least squares of its equations, sample by sample, in memory whose size is known
//! and without allocation ([`recursive_source`]). The arithmetic is that of
//! [`recursive()`](fdm_estimate::equation_error::recursive()), step by step.

use crate::Stamp;
use fdm_estimate::equation_error::{EstimatorEquation, RecursiveEstimator};
use fdm_grammar::emit::{TooLong, c_comment, c_function, c_name, c_number};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Quantity};

/// Why there is no such estimator.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoEstimator {
    /// The derivative of an input at a sample needs the sample behind it.
    #[error("the equations read `{0}`, which needs the next sample: measure it as an input of its own")]
    Derivative(String),
    /// A delay that looks ahead, or is none.
    #[error(
        "the delay of `{0}` is negative, or brought by each run: an estimator in flight needs a number that is not negative"
    )]
    Ahead(String),
    /// How a state is read depends on what a run brings.
    #[error("how outputs show `{0}` depends on a value that each run brings: make that a param")]
    Brought(String),
    /// A function would need too much stack.
    #[error("{0}")]
    TooLong(TooLong),
}

/// A name that only these files declare, behind their prefix.
pub(crate) const MARK: &str = "RECURSIVE_ESTIMATOR";

/// The source file; its last line is the stamp.
///
/// # Errors
/// [`NoEstimator`].
pub fn recursive_source(estimator: &RecursiveEstimator) -> Result<String, NoEstimator> {
    let writer = Writer::new(estimator)?;
    let late = !writer.late.is_empty();
    let when_late = |text: &'static str| if late { text } else { "" };
    let head = HEAD.replace("%TITLE%", &writer.title()).replace("%SIZES%", &writer.sizes());
    let head = head.replace("%PAST%", when_late(PAST_FIELDS));
    let columns = c_function(&writer.prefix, "columns", &estimator.program()).map_err(NoEstimator::TooLong)?;
    let sample = SAMPLE.replace("%PAST_EMPTY%", when_late(PAST_EMPTY)).replace("%PAST_KEPT%", when_late(PAST_KEPT));
    let parts = [&head, &columns, &writer.tables(), CORE, when_late(PAST), &sample];
    let text = parts.concat().replace('@', &writer.prefix);
    Ok(format!("{text}\n/* {} */\n", Stamp::of(estimator.model())))
}

/// A delayed signal that the equations read.
struct Late {
    /// Its place in the drive.
    place: usize,
    /// The signal: a state, or behind the states an input.
    signal: usize,
    held: bool,
    tau: f64,
}

struct Writer<'a> {
    prefix: String,
    estimator: &'a RecursiveEstimator,
    equations: Vec<EstimatorEquation>,
    /// Of each state the output that shows it, slope and offset.
    readings: Vec<Option<(usize, f64, f64)>>,
    late: Vec<Late>,
    /// Inputs that the caller brings; hidden ones behind them are filled from outputs.
    declared: usize,
}

impl<'a> Writer<'a> {
    fn new(estimator: &'a RecursiveEstimator) -> Result<Self, NoEstimator> {
        let (definition, layout) = (estimator.model().definition(), estimator.model().layout());
        if let Some(k) = estimator.derivatives().first() {
            return Err(NoEstimator::Derivative(definition.inputs[*k].quantity.name.clone()));
        }
        let readings = estimator.readings();
        for (state, reading) in definition.states.iter().zip(&readings) {
            if reading.is_some_and(|(_, slope, offset)| !(slope.is_finite() && offset.is_finite())) {
                return Err(NoEstimator::Brought(state.quantity.name.clone()));
            }
        }
        let mut late = Vec::new();
        for (k, signal, tau) in estimator.delays() {
            let (signal, held, name) = match signal {
                Signal::State(s) => (s as usize, false, &definition.states[s as usize].quantity.name),
                Signal::Input(u) => {
                    let held = estimator.constants().held[u as usize];
                    (layout.states + u as usize, held, &definition.inputs[u as usize].quantity.name)
                }
            };
            if !(tau >= 0.0 && tau.is_finite()) {
                return Err(NoEstimator::Ahead(name.clone()));
            }
            late.push(Late { place: layout.inputs + k, signal, held, tau });
        }
        let declared = definition.inputs.iter().take_while(|i| i.is_declared()).count();
        let (prefix, equations) = (format!("{}_", c_name(estimator.model().name())), estimator.equations());
        Ok(Self { prefix, estimator, equations, readings, late, declared })
    }

    /// Indices of the estimated parameters, group by group.
    fn unknowns(&self) -> Vec<u32> {
        self.estimator.constants().groups.iter().flat_map(|g| g.params.iter().copied()).collect()
    }

    fn title(&self) -> String {
        let definition = self.estimator.model().definition();
        let named = |q: &Quantity| {
            let unit = q.unit.as_ref().map(|u| format!(" [{u}]")).unwrap_or_default();
            c_comment(&format!("{}{unit}", q.name))
        };
        let list = |title: &str, all: Vec<String>| {
            let lines = all.iter().enumerate().map(|(k, name)| format!(" *   {k:<4} {name}\n"));
            format!(" *\n * {title}\n{}", lines.collect::<String>())
        };
        let group = |e: &EstimatorEquation| {
            let names = e.params.iter().map(|k| definition.params[*k as usize].quantity.name.as_str());
            c_comment(&format!("{}: {}", e.name, names.collect::<Vec<_>>().join(", ")))
        };
        let unknown = |k: &u32| named(&definition.params[*k as usize].quantity);
        [
            format!(" * {}: its parameters, followed sample by sample\n *\n", c_comment(&definition.name)),
            format!(
                " * Written by fdm {} from the model's text; times are in {}.\n",
                env!("CARGO_PKG_VERSION"),
                definition.time
            ),
            list("equations and their parameters", self.equations.iter().map(group).collect()),
            list("u: inputs", definition.inputs[..self.declared].iter().map(|i| named(&i.quantity)).collect()),
            list(
                "y: outputs; NAN where nothing was measured",
                definition.outputs.iter().map(|o| named(&o.quantity)).collect(),
            ),
            list("value, error: parameters", self.unknowns().iter().map(unknown).collect()),
        ]
        .concat()
    }

    fn sizes(&self) -> String {
        let (layout, constants) = (self.estimator.model().layout(), self.estimator.constants());
        let unknowns = |g: &fdm_estimate::equation_error::ParameterGroup| g.params.len();
        let columns: usize = self.equations.iter().map(|e| 1 + e.params.len()).sum();
        let list = [
            ("INPUTS", self.declared, "inputs that are given"),
            ("OUTPUTS", layout.outputs, "outputs that are given"),
            ("UNKNOWNS", constants.groups.iter().map(unknowns).sum(), "parameters that are estimated"),
            ("PARAMS", layout.params, "all parameters"),
            ("STATES", layout.states, "states"),
            ("SIGNALS", layout.inputs, "inputs, and outputs that the equations read"),
            ("DRIVE", layout.inputs + self.estimator.delayed_count(), "signals, then delayed ones"),
            ("EQUATIONS", self.equations.len(), "equations"),
            ("COLUMNS", columns, "of each equation the known part and a column for each parameter"),
            ("GROUPS", constants.groups.len(), "groups of equations that share parameters"),
            ("ROOT", constants.groups.iter().map(|g| g.params.len().pow(2)).sum(), "numbers of all covariances"),
        ];
        let mut text: String =
            list.iter().map(|(name, value, about)| format!("    @{name} = {value}, /* {about} */\n")).collect();
        if !self.late.is_empty() {
            let longest = self.late.iter().fold(0.0_f64, |most, l| most.max(l.tau));
            // twice what the records needed, for intervals that are shorter in flight
            let kept = (2.0 * longest / constants.interval).ceil().clamp(6.0, 1e6) as usize + 2;
            text += &format!("    @LATE = {}, /* delayed signals */\n", self.late.len());
            text = format!(
                "#ifndef @HISTORY\n#define @HISTORY {kept} /* samples that are kept for delays */\n#endif\n\nenum {{\n{text}"
            );
        } else {
            text = format!("enum {{\n{text}");
        }
        format!("{text}    @{MARK} = 1\n}};\n")
    }

    fn tables(&self) -> String {
        let (definition, constants) = (self.estimator.model().definition(), self.estimator.constants());
        let table = |kind: &str, name: &str, values: Vec<String>| {
            let (length, none) = (values.len().max(1), if values.is_empty() { "0" } else { "" });
            format!("static const {kind} @{name}[{length}] = {{{}{none}}};\n", values.join(", "))
        };
        let whole = |values: Vec<i64>| values.iter().map(ToString::to_string).collect::<Vec<_>>();
        let real = |values: Vec<f64>| values.iter().map(|v| c_number(*v)).collect::<Vec<_>>();
        let unknowns = self.unknowns();
        let place = |param: &u32| unknowns.iter().position(|k| k == param);
        let running = |lengths: Vec<usize>| {
            let mut sum = 0;
            let ends = lengths.into_iter().map(|length| {
                sum += length as i64;
                sum
            });
            std::iter::once(0).chain(ends).collect::<Vec<i64>>()
        };
        // the group of the first parameter that is estimated; none where the records moved no column
        let group_of = |e: &EstimatorEquation| {
            let groups = constants.groups.iter().enumerate();
            groups.clone().find(|(_, g)| e.params.iter().any(|p| g.params.contains(p))).map_or(-1, |(k, _)| k as i64)
        };
        let of_columns = self
            .equations
            .iter()
            .flat_map(|e| std::iter::once(-1).chain(e.params.iter().map(|p| place(p).map_or(-1, |k| k as i64))));
        let brought = definition.params.iter().map(|p| match p.origin {
            Origin::FirstSample(input) => i64::from(input),
            _ => -1,
        });
        let hidden = definition.inputs.iter().map(|i| i.measured.map_or(-1, i64::from));
        let (outputs, lines): (Vec<i64>, Vec<(f64, f64)>) = self
            .readings
            .iter()
            .map(|r| r.map_or((-1, (1.0, 0.0)), |(output, slope, offset)| (output as i64, (slope, offset))))
            .unzip();
        let (slopes, offsets) = lines.into_iter().unzip();
        let lengths = constants.groups.iter().map(|g| g.params.len());
        let scale = constants.groups.iter().flat_map(|g| g.scale.iter().copied());
        let mut text = String::from("\n");
        text += &table("int", "group_first", whole(running(lengths.clone().collect())));
        text += &table("int", "root_first", whole(running(lengths.map(|p| p * p).collect())));
        text += &table("int", "unknown_param", whole(unknowns.iter().map(|k| i64::from(*k)).collect()));
        text += &table("int", "equation_group", whole(self.equations.iter().map(group_of).collect()));
        text += &table("int", "equation_state", whole(self.equations.iter().map(|e| e.state as i64).collect()));
        text +=
            &table("int", "column_first", whole(running(self.equations.iter().map(|e| 1 + e.params.len()).collect())));
        text += &table("int", "column_unknown", whole(of_columns.collect()));
        text += &table("int", "state_output", whole(outputs));
        text += &table("double", "state_slope", real(slopes));
        text += &table("double", "state_offset", real(offsets));
        text += &table("int", "signal_output", whole(hidden.collect()));
        text += &table("int", "signal_held", whole(constants.held.iter().map(|h| i64::from(*h)).collect()));
        text += &table("int", "param_brought", whole(brought.collect()));
        let start = definition.params.iter().map(|p| if p.is_recorded() { 0.0 } else { p.value });
        text += &table("double", "param_start", real(start.collect()));
        text += &table("double", "weight", real(constants.weights.clone()));
        text += &table("double", "scale", real(scale.collect()));
        text += &table("double", "open", real(constants.groups.iter().map(|g| g.open).collect()));
        text += &format!("static const double @forgetting = {};\n", c_number(constants.forgetting));
        if !self.late.is_empty() {
            text += &table("int", "late_place", whole(self.late.iter().map(|l| l.place as i64).collect()));
            text += &table("int", "late_signal", whole(self.late.iter().map(|l| l.signal as i64).collect()));
            text += &table("int", "late_held", whole(self.late.iter().map(|l| i64::from(l.held)).collect()));
            text += &table("double", "late_tau", real(self.late.iter().map(|l| l.tau).collect()));
        }
        text
    }
}

/// `@` stands for the prefix.
const HEAD: &str = "\
/*
%TITLE% *
 * Recursive least squares with forgetting: the steps and the arithmetic of `fdm regress --recursive`, on samples as they come. All memory is
 * one @estimator; nothing is allocated, nothing is kept of a record but the sample before (and what delays need), and every sample
 * costs the same. Weights, scales and the first uncertainty are those of the records that this file was written with; they are fields,
 * and so are the forgetting and all other parameters, which may be changed behind @begin (a mass that is known to change).
 *
 *   static @estimator e;
 *   @begin(&e);
 *   for every sample: @sample(&e, t, u, y);
 *   whenever wanted:  @estimate(&e, value, error);
 *
 * A number that was not measured is NAN: equations that need it leave out both steps beside it. Compile without -ffast-math.
 */
#ifndef @ESTIMATOR_DECLARED
#define @ESTIMATOR_DECLARED

%SIZES%
typedef struct {
    /* What may be changed behind @begin. */
    double forgetting;                  /* weight of a step relative to the one behind it: above 0, at most 1 */
    double param[@PARAMS + 1];          /* all parameters: only those that are not estimated are read */
    double weight[@EQUATIONS + 1];      /* one over the residual of each equation */
    double scale[@UNKNOWNS + 1];        /* size of each weighted column */
    double open[@GROUPS + 1];           /* standard deviation of scaled values at the beginning */
    /* What is estimated. */
    double scaled[@UNKNOWNS + 1];       /* values times their scales */
    double root[@ROOT + 1];             /* square roots of the covariances, by groups */
    double squares[@GROUPS + 1];        /* squared innovations with forgetting */
    double count[@GROUPS + 1];          /* and their number */
    /* The sample before. */
    int begun;
    double t;
    double x[@STATES + 1];
    double signal[@SIGNALS + 1];
    double before[@COLUMNS + 1];        /* columns at the beginning of the step */
%PAST%} @estimator;

#ifdef __cplusplus
extern \"C\" {
#endif

/* Forgets everything: the values of the model, and nothing known about them. */
void @begin(@estimator *e);

/* Another flight or segment: the next sample is a first one; what is known of the parameters stays. */
void @new_run(@estimator *e);

/* Takes a sample: the time since the run began, inputs, outputs. Returns the number of equations that moved their parameters, or -1
 * where the time does not rise; such a sample is left out. */
int @sample(@estimator *e, double t, const double *u, const double *y);

/* Values of the parameters and their standard errors (as far as residuals are white), UNKNOWNS of each. */
void @estimate(const @estimator *e, double *value, double *error);

#ifdef __cplusplus
}
#endif

#endif

#ifndef FDM_DECLARATIONS_ONLY

";

/// Fields for delays.
const PAST_FIELDS: &str = "    /* The past, for delays: a ring. */
    int kept;
    int newest;
    int dropped;
    double past_t[@HISTORY];
    double past[@HISTORY][@LATE];
";

/// The filter.
const CORE: &str = "
static double @variance(const double *row, int p)
{
    double sum = 0.0;
    int k;
    for (k = 0; k < p; k++)
        sum += row[k] * row[k];
    return sum;
}

/* Forgets a part of what was known, but never more than was unknown at the beginning. */
static void @forget(@estimator *e, int g)
{
    const int p = @group_first[g + 1] - @group_first[g];
    double *root = e->root + @root_first[g];
    const double wider = 1.0 / sqrt(e->forgetting);
    int k;
    e->squares[g] = e->forgetting * e->squares[g];
    e->count[g] = e->forgetting * e->count[g];
    for (k = 0; k < p; k++)
        if (!(@variance(root + k * p, p) < e->open[g] * e->open[g]))
            return;
    for (k = 0; k < p * p; k++)
        root[k] *= wider;
}

/* Takes one row: gain, values, and the covariance by its square root (Potter 1963). */
static void @take(@estimator *e, int equation, double left, const double *column)
{
    const int g = @equation_group[equation], first = @group_first[g], p = @group_first[g + 1] - first;
    const int *unknown = @column_unknown + @column_first[equation] + 1;
    const int columns = @column_first[equation + 1] - @column_first[equation] - 1;
    const double weight = e->weight[equation];
    double *root = e->root + @root_first[g], *scaled = e->scaled + first;
    double row[@UNKNOWNS + 1], along[@UNKNOWNS + 1];
    double squares = 0.0, expected = 0.0, size, innovation, shrink;
    int a, b;
    for (a = 0; a < p; a++)
        row[a] = 0.0;
    for (a = 0; a < columns; a++)
        if (unknown[a] >= 0)
            row[unknown[a] - first] = weight * column[a] / e->scale[unknown[a]];
    for (b = 0; b < p; b++) {
        along[b] = 0.0;
        for (a = 0; a < p; a++)
            along[b] += root[a * p + b] * row[a];
    }
    for (b = 0; b < p; b++)
        squares += along[b] * along[b];
    size = 1.0 + squares;
    for (a = 0; a < p; a++)
        expected += row[a] * scaled[a];
    innovation = weight * left - expected;
    e->squares[g] += innovation * innovation / size;
    e->count[g] += 1.0;
    shrink = 1.0 / (size + sqrt(size));
    for (a = 0; a < p; a++) {
        double gain = 0.0;
        for (b = 0; b < p; b++)
            gain += root[a * p + b] * along[b];
        for (b = 0; b < p; b++)
            root[a * p + b] -= shrink * gain * along[b];
        scaled[a] += gain * innovation / size;
    }
}
";

/// Delays.
const PAST: &str = "
/* Keeps the signals that are read late. */
static void @keep(@estimator *e, double t, const double *x, const double *signal)
{
    int k;
    if (e->kept < @HISTORY)
        e->kept++;
    else
        e->dropped = 1;
    e->newest = (e->newest + 1) % @HISTORY;
    e->past_t[e->newest] = t;
    for (k = 0; k < @LATE; k++) {
        const int s = @late_signal[k];
        e->past[e->newest][k] = s < @STATES ? x[s] : signal[s - @STATES];
    }
}

/* A signal at an earlier time: linear between samples, or held; before the first sample its value, NAN before what is kept. */
static double @late(const @estimator *e, double t, int k)
{
    int back, left = e->newest, right = -1;
    for (back = 0; back < e->kept; back++) {
        left = (e->newest + @HISTORY - back) % @HISTORY;
        if (e->past_t[left] <= t)
            break;
        right = left;
    }
    if (back == e->kept)
        return e->dropped ? NAN : e->past[left][k];
    if (right < 0 || @late_held[k] || t == e->past_t[left])
        return e->past[left][k];
    return e->past[left][k]
        + (t - e->past_t[left]) / (e->past_t[right] - e->past_t[left]) * (e->past[right][k] - e->past[left][k]);
}
";

const PAST_EMPTY: &str = "    e->kept = 0;
    e->newest = -1;
    e->dropped = 0;
";

const PAST_KEPT: &str = "    @keep(e, t, x, drive);
    for (k = 0; k < @LATE; k++)
        drive[@late_place[k]] = @late(e, t - @late_tau[k], k);
";

/// What is called.
const SAMPLE: &str = "
void @new_run(@estimator *e)
{
    e->begun = 0;
%PAST_EMPTY%}

void @begin(@estimator *e)
{
    int g, k;
    e->forgetting = @forgetting;
    for (k = 0; k < @PARAMS; k++)
        e->param[k] = @param_start[k];
    for (k = 0; k < @EQUATIONS; k++)
        e->weight[k] = @weight[k];
    for (k = 0; k < @ROOT; k++)
        e->root[k] = 0.0;
    for (k = 0; k < @UNKNOWNS; k++) {
        e->scale[k] = @scale[k];
        e->scaled[k] = @param_start[@unknown_param[k]] * @scale[k];
    }
    for (g = 0; g < @GROUPS; g++) {
        const int p = @group_first[g + 1] - @group_first[g];
        e->open[g] = @open[g];
        e->squares[g] = 0.0;
        e->count[g] = 0.0;
        for (k = 0; k < p; k++)
            e->root[@root_first[g] + k * p + k] = @open[g];
    }
    @new_run(e);
}

int @sample(@estimator *e, double t, const double *u, const double *y)
{
    double x[@STATES + 1], drive[@DRIVE + 1], now[@COLUMNS + 1];
    int g, k, moved = 0;
    if (!isfinite(t) || (e->begun && !(t > e->t)))
        return -1;
    for (k = 0; k < @DRIVE; k++)
        drive[k] = NAN;
    for (k = 0; k < @SIGNALS; k++)
        drive[k] = k < @INPUTS ? u[k] : @signal_output[k] >= 0 ? y[@signal_output[k]] : NAN;
    for (k = 0; k < @STATES; k++)
        x[k] = @state_output[k] >= 0 ? (y[@state_output[k]] - @state_offset[k]) / @state_slope[k] : NAN;
    for (k = 0; k < @PARAMS; k++)
        if (!e->begun && @param_brought[k] >= 0)
            e->param[k] = drive[@param_brought[k]];
%PAST_KEPT%    if (e->begun) {
        const double dt = t - e->t;
        double end[@DRIVE + 1];
        for (k = 0; k < @DRIVE; k++)
            end[k] = k < @SIGNALS && @signal_held[k] ? e->signal[k] : drive[k];
        @columns(t, x, end, e->param, now);
        for (g = 0; g < @GROUPS; g++) {
            int forgotten = 0;
            for (k = 0; k < @EQUATIONS; k++) {
                const int first = @column_first[k], columns = @column_first[k + 1] - first;
                const double slope = (x[@equation_state[k]] - e->x[@equation_state[k]]) / dt;
                double mean[@COLUMNS + 1];
                int i, whole = isfinite(slope);
                if (@equation_group[k] != g)
                    continue;
                for (i = 0; i < columns; i++) {
                    mean[i] = 0.5 * (e->before[first + i] + now[first + i]);
                    whole = whole && isfinite(mean[i]);
                }
                if (!whole)
                    continue;
                if (!forgotten) {
                    @forget(e, g);
                    forgotten = 1;
                }
                @take(e, k, slope - mean[0], mean + 1);
                moved++;
            }
        }
    }
    @columns(t, x, drive, e->param, e->before);
    for (k = 0; k < @STATES; k++)
        e->x[k] = x[k];
    for (k = 0; k < @SIGNALS; k++)
        e->signal[k] = drive[k];
    e->t = t;
    e->begun = 1;
    return moved;
}

void @estimate(const @estimator *e, double *value, double *error)
{
    int g, k;
    for (g = 0; g < @GROUPS; g++) {
        const int first = @group_first[g], p = @group_first[g + 1] - first;
        const double left = e->count[g] - (double)p;
        const double variance = e->squares[g] / (left > 1.0 ? left : 1.0);
        for (k = 0; k < p; k++) {
            value[first + k] = e->scaled[first + k] / e->scale[first + k];
            error[first + k] = sqrt(variance * @variance(e->root + @root_first[g] + k * p, p)) / e->scale[first + k];
        }
    }
}

#endif
";
