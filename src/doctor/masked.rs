//! Records without the samples that are not to be believed.

use crate::edit::{Channels, Slot, put};
use crate::finding::Finding;
use crate::record::Record;
use fdm_system::record::{Run, bridge};

/// The runs and their records without the samples that findings do not believe: gaps of outputs, bridged inputs.
pub fn mask(channels: &Channels, runs: &[Run], records: &[Record], findings: &[Finding]) -> (Vec<Run>, Vec<Record>) {
    let (mut masked, mut clean) = (runs.to_vec(), records.to_vec());
    for finding in findings.iter().filter(|f| !f.samples.is_empty()) {
        let Some(slot) = channels.slots().find(|s| finding.channels.first().is_some_and(|c| c == channels.name(*s)))
        else {
            continue;
        };
        let Some((run, record)) = masked.iter_mut().zip(&mut clean).find(|(run, _)| run.name == finding.run) else {
            continue;
        };
        let values = &mut record.channels[channels.place(slot)].values;
        finding.samples.iter().for_each(|k| values[*k] = f64::NAN);
        if values.iter().all(|v| v.is_nan()) {
            continue;
        }
        if matches!(slot, Slot::Input(_)) {
            bridge(&run.time, values, 1, 0, false);
        }
        put(run, slot, values);
    }
    (masked, clean)
}
