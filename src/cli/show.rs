//! `fdm show`: what becomes of a model's text, stage by stage.

use crate::failure::{Failure, NUMBERS, print};
use crate::subject::{Estimated, Subject};
use clap::{Args, ValueEnum};
use fdm::report::{Stage, dot, stage};
use std::process::ExitCode;

/// What `fdm show` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    /// Which stage
    #[arg(long, value_name = "STAGE", default_value = "model")]
    stage: Chosen,
    /// The graph in the language of Graphviz
    #[arg(long, conflicts_with = "json")]
    dot: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// The stages by the names under which they are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Chosen {
    /// The text as it was understood, in normal form
    Syntax,
    /// What every name is, and the equations
    Model,
    /// The nodes that the equations share
    Graph,
    /// Every partial derivative that is not zero
    Derivatives,
    /// The straight-line programs
    Schedule,
    /// The machine code
    Code,
    /// A, B, C, D at the trim, as numbers and as expressions
    Linear,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.dot && arguments.stage != Chosen::Graph {
        return Err(Failure::input(["--dot draws the graph: give --stage graph with it"]));
    }
    let model = arguments.subject.load()?;
    let mut params = model.definition().params.clone();
    arguments.subject.changes(&Estimated::default()).apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let text = if arguments.dot {
        dot(&model)
    } else {
        let shown = stage(&model, arguments.stage.into()).map_err(|e| Failure::input([e]))?;
        if arguments.json { format!("{}\n", shown.json) } else { shown.text }
    };
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

impl From<Chosen> for Stage {
    fn from(chosen: Chosen) -> Self {
        match chosen {
            Chosen::Syntax => Self::Syntax,
            Chosen::Model => Self::Model,
            Chosen::Graph => Self::Graph,
            Chosen::Derivatives => Self::Derivatives,
            Chosen::Schedule => Self::Schedule,
            Chosen::Code => Self::Code,
            Chosen::Linear => Self::Linear,
        }
    }
}
