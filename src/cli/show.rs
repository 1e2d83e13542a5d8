//! `fdm show`: what becomes of a model's text, stage by stage.

use crate::failure::{Ending, Failure, OrFailure, ended, print_lines};
use clap::{Args, ValueEnum};
use fdm_report::{Stage, dot, stage};
use fdm_session::load::{Estimated, ModelFile};

/// What `fdm show` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelFile,
    /// Stage of compilation
    #[arg(long, value_name = "STAGE", default_value = "model")]
    stage: Chosen,
    /// The graph for Graphviz (DOT)
    #[arg(long, conflicts_with = "json")]
    dot: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// The stages by the names under which they are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Chosen {
    /// The parsed text, in normal form
    Syntax,
    /// All names with their roles, and the equations
    Model,
    /// The expression graph, with shared subexpressions
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

pub(crate) fn run(arguments: &Arguments) -> Ending {
    if arguments.dot && arguments.stage != Chosen::Graph {
        return Err(Failure::input(["--dot cannot be combined with this stage: use --stage graph"]));
    }
    let model = arguments.model.load_changed(&Estimated::default())?;
    let text = if arguments.dot {
        dot(&model)
    } else {
        let shown = stage(&model, arguments.stage.into()).or_failure()?;
        if arguments.json { format!("{}\n", shown.json().or_failure()?) } else { shown.text }
    };
    ended(print_lines(&text))
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
