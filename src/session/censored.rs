//! Samples below a limit: what a fit is told of them, and the deviation of the noise that their probability wants, as a param in the model's text. What is
//! fitted is what is written.

use crate::failure::Failure;
use crate::session::Session;
use crate::telling::remark;
use fdm_estimate::Fit;
use fdm_grammar::model::Output;
use fdm_grammar::syntax::{Role, StatementKind, parse};
use fdm_grammar::{Source, gather};
use fdm_system::Model;
use fdm_system::record::{Censored, Run};

impl Session {
    /// The samples of the fitted runs of which only a limit is known.
    pub(crate) fn censored(&self) -> Vec<Censored> {
        let of = |(run, summary): (&Run, &fdm_system::record::Summary)| {
            let named = |c: &Censored| Censored { run: run.name.clone(), ..c.clone() };
            summary.censored.iter().map(named).collect::<Vec<_>>()
        };
        self.fitted().filter_map(|(run, origin)| Some((run, origin.summary.as_ref()?))).flat_map(of).collect()
    }

    /// Those of outputs whose noise the model states: of others their probability is not known.
    pub(crate) fn censored_with_noise(&self) -> Vec<Censored> {
        let outputs = &self.model.definition().outputs;
        let is_stated = |c: &Censored| outputs[c.output].noise.is_some() || outputs[c.output].noise_model.is_some();
        self.censored().into_iter().filter(is_stated).collect()
    }

    /// With a param for the deviation of each output that has samples below a limit, and of whose noise the model and `--noise` say nothing (`words`).
    ///
    /// # Errors
    /// [`Failure`], where the text with the param is none.
    pub(crate) fn with_noise_of_censored(mut self, words: &[String]) -> Result<Self, Failure> {
        let censored = self.censored();
        // one size for all, or all together: what these words leave out the fit says
        if censored.is_empty() || words.iter().any(|w| w == "diagonal" || w == "full") {
            return Ok(self);
        }
        let outputs = self.model.definition().outputs.clone();
        for (o, output) in outputs.iter().enumerate().filter(|(o, _)| censored.iter().any(|c| c.output == *o)) {
            let typed = words.iter().any(|w| w.split_once('=').is_some_and(|(name, _)| name == output.quantity.name));
            if output.noise.is_some() || output.noise_model.is_some() || typed {
                continue;
            }
            if let Some((model, param)) = with_noise(&self.model, output, spread(&self.runs, o, outputs.len()))? {
                let name = &output.quantity.name;
                let said = "the probability of its samples below a limit wants it, and the model says nothing of it";
                remark(format_args!("note: param `{param}` is the deviation of the noise of `{name}`: {said}"));
                self.model = model;
            }
        }
        Ok(self)
    }

    /// Refuses samples below a limit, where `what` has no place for them.
    ///
    /// # Errors
    /// [`Failure`]
    pub(crate) fn refuse_censored(self, what: &str) -> Result<Self, Failure> {
        let Some(first) = self.censored().into_iter().next() else { return Ok(self) };
        let output = &self.model.definition().outputs[first.output].quantity.name;
        Err(Failure::input([format!(
            "run `{}`: `{output}` has samples below a limit, which {what} cannot compare; `fdm fit` can, by output error in the time domain; \
             --below-limit missing leaves them out, and estimates lean then to what was seen",
            first.run
        )]))
    }
}

/// How many of the samples below a limit a fit has there too, output by output.
pub(crate) fn predicted_below(fit: &Fit, session: &Session) -> Vec<String> {
    let (outputs, censored) = (&session.model.definition().outputs, session.censored());
    let of = |(o, output): (usize, &Output)| {
        let own: Vec<&Censored> = censored.iter().filter(|c| c.output == o).collect();
        let is_below = |c: &&&Censored| {
            let run = session.runs.iter().zip(&fit.estimate.runs).find(|(run, _)| run.name == c.run);
            run.is_some_and(|(run, predicted)| {
                let at = run.time.iter().position(|t| *t == c.time);
                at.and_then(|at| predicted.response.get(at * outputs.len() + o)).is_some_and(|y| *y < c.limit)
            })
        };
        let (name, below) = (&output.quantity.name, own.iter().filter(is_below).count());
        let said = format!(
            "note: `{name}` has {} sample(s) below their limit, {below} of which are predicted there",
            own.len()
        );
        (!own.is_empty()).then_some(said)
    };
    outputs.iter().enumerate().filter_map(of).collect()
}

/// Standard deviation of the values of an output in all runs: a noise is no larger. 1 where it does not vary.
fn spread(runs: &[Run], output: usize, outputs: usize) -> f64 {
    let values = || runs.iter().flat_map(|r| r.measured.iter().skip(output).step_by(outputs)).filter(|z| !z.is_nan());
    let count = values().count().max(1) as f64;
    let mean = values().sum::<f64>() / count;
    let spread = (values().map(|z| (z - mean) * (z - mean)).sum::<f64>() / count).sqrt();
    if spread > 0.0 { spread } else { 1.0 }
}

/// The model with a param for the deviation of an output's noise, and its name; none of outputs that this text does not declare by a plain name.
fn with_noise(model: &Model, output: &Output, start: f64) -> Result<Option<(Model, String)>, Failure> {
    let (base, name) = (model.source(), &output.quantity.name);
    let Ok(tree) = parse(base) else { return Ok(None) };
    let declares = |kind: &StatementKind| match kind {
        StatementKind::Declare(Role::Output, list) => list.iter().any(|d| d.name.text == *name && d.shape.is_none()),
        _ => false,
    };
    let Some(statement) = tree.statements.iter().find(|s| declares(&s.kind)) else { return Ok(None) };
    let names: Vec<String> = model.definition().params.iter().map(|p| p.quantity.name.clone()).collect();
    let mut param = format!("sigma_{name}");
    while names.contains(&param) {
        param.push('_');
    }
    let unit = output.quantity.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
    let lines = format!("\n  param {param} = {start:?} in [0, inf]{unit};\n  noise {name} = {param};");
    let mut text = base.text().to_string();
    text.insert_str(statement.span.end as usize, &lines);
    let mut source = Source::new(base.name(), text).with_groups(base.groups().clone());
    gather(&mut source, &mut |file| {
        let used = base.find(file).map(|k| base.texts()[k].text().to_string());
        used.ok_or_else(|| "it was not there before".to_string())
    });
    let model = Model::from_source(source).map_err(|e| Failure::Model(Box::new(e)))?;
    Ok(Some((model, param)))
}
