//! Pauses of a logger: nobody knows what drove the model meanwhile, so that a run goes on behind one as another run, with a beginning of its own.

use super::channel::Channels;
use super::even_grid::Sampling;
use super::note::Note;
use super::samples::Samples;

/// Intervals of uneven sampling differ; a pause is far beyond that.
pub(crate) const PAUSE: f64 = 10.0;

/// Cuts samples at their pauses, where inputs would have to be invented for these and the model can begin anywhere. Pieces that hold too little to
/// determine their own beginning are left out. What is done is said.
pub(crate) fn cut(samples: Samples, (inputs, channels): (&[usize], &Channels), notes: &mut Vec<Note>) -> Vec<Samples> {
    let usual = Sampling::new(&samples.time).map_or(f64::INFINITY, |s| PAUSE * s.median);
    let drives = |k: &usize| {
        let mut values = samples.inputs.iter().skip(*k).step_by(channels.inputs.len()).filter(|v| !v.is_nan());
        values.next().is_some_and(|first| values.any(|v| v != first))
    };
    let pauses: Vec<usize> =
        (1..samples.time.len()).filter(|k| samples.time[*k] - samples.time[k - 1] > usual).collect();
    let moved = inputs.iter().any(|k| !channels.inputs[*k].known && drives(k));
    let Some(states) = channels.begins_anywhere.filter(|_| moved && !pauses.is_empty()) else { return vec![samples] };
    let ends = pauses.iter().copied().chain([samples.time.len()]);
    let pieces: Vec<_> = [0].into_iter().chain(pauses.iter().copied()).zip(ends).map(|(a, b)| a..b).collect();
    let (kept, short): (Vec<_>, Vec<_>) = pieces.into_iter().partition(|piece| piece.len() > states.max(1));
    if kept.len() < 2 && short.is_empty() {
        return vec![samples];
    }
    let lost: usize = short.iter().map(ExactSizeIterator::len).sum();
    notes.push(Note::Segments { pauses: pauses.len(), runs: kept.len(), lost });
    kept.into_iter().map(|piece| samples.piece(piece)).collect()
}
