//! What should not be overlooked in a result, as lines: all of it, or the heaviest with what to do about each.

use fdm_results::documents::Remark;

/// Remarks as lines: all of them, or the heaviest with what to do about each.
pub(crate) fn lines(remarks: &[Remark], verbose: bool) -> Vec<String> {
    if verbose { shortened(remarks) } else { first(remarks) }
}

/// Remarks that are shown where not all are wanted.
const FIRST: usize = 5;

/// One line for each kind, the heaviest first: the first of its kind, how many there are like it, and what to do.
fn first(remarks: &[Remark]) -> Vec<String> {
    let mut kinds: Vec<(&Remark, usize)> = Vec::new();
    for remark in remarks {
        match kinds.iter_mut().find(|(first, _)| first.about == remark.about) {
            Some((_, count)) => *count += 1,
            None => kinds.push((remark, 1)),
        }
    }
    kinds.sort_by_key(|(remark, _)| remark.about.rank());
    let line = |(remark, count): &(&Remark, usize)| {
        let alike = if *count > 1 { format!(" (and {} like it)", count - 1) } else { String::new() };
        let advice = remark.about.advice().map_or(String::new(), |advice| format!("; {advice}"));
        format!("{}{alike}{advice}", cut(&remark.sentence))
    };
    let mut lines: Vec<String> = kinds.iter().take(FIRST).map(line).collect();
    let more = remarks.len() - kinds.len().min(FIRST);
    if more > 0 {
        lines.push(format!("{more} more remark{}: --verbose", if more == 1 { "" } else { "s" }));
    }
    lines
}

/// Remarks of one kind that are shown; JSON holds all of them.
const SHOWN: usize = 8;
/// Characters of a remark that are shown.
const LONGEST: usize = 600;

/// Remarks as lines: of each kind the first few and how many more there are, long ones cut between words.
fn shortened(remarks: &[Remark]) -> Vec<String> {
    let mut lines = Vec::new();
    for alike in remarks.chunk_by(|a, b| a.about == b.about) {
        // one more than is shown takes no more room than a line that says so
        let shown = if alike.len() > SHOWN + 1 { SHOWN } else { alike.len() };
        lines.extend(alike[..shown].iter().map(|remark| cut(&remark.sentence)));
        if shown < alike.len() {
            lines.push(format!("and {} more remarks of this kind (--json has all)", alike.len() - shown));
        }
    }
    lines
}

fn cut(sentence: &str) -> String {
    let Some((end, _)) = sentence.char_indices().nth(LONGEST) else { return sentence.into() };
    let end = sentence[..end].rfind(' ').unwrap_or(end);
    format!("{} ... (--json has the whole of it)", &sentence[..end])
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_results::documents::About;

    fn remark(about: About, sentence: &str) -> Remark {
        Remark { about, sentence: sentence.into() }
    }

    #[test]
    fn long_lists_and_long_remarks_are_shortened_and_short_ones_are_not() {
        let many: Vec<Remark> = (0..90).map(|k| remark(About::Input, &format!("run {k}"))).collect();
        let shown = shortened(&[&[remark(About::Colour, "coloured")], &many[..]].concat());
        assert_eq!(shown.len(), 1 + SHOWN + 1);
        assert_eq!(shown[SHOWN + 1], "and 82 more remarks of this kind (--json has all)");
        assert_eq!(shortened(&many[..SHOWN + 1]).len(), SHOWN + 1);
        let long = vec!["`parameter`"; 10_000].join(", ");
        let line = &shortened(&[remark(About::Undetermined, &long)])[0];
        assert!(line.len() < 700 && line.ends_with("`parameter`, ... (--json has the whole of it)"), "{line}");
    }

    #[test]
    fn the_heaviest_remarks_come_first_and_say_what_to_do() {
        let kinds = [About::Iteration, About::Correlated, About::Colour, About::Input, About::Bound, About::Table];
        let mut all: Vec<Remark> = kinds.iter().map(|about| remark(*about, &format!("{about:?}"))).collect();
        all.insert(2, remark(About::Correlated, "other"));
        let shown = first(&all);
        let expected = [
            "Bound",
            "Input; `fdm diagnose` looks for what is missing",
            "Colour",
            "Correlated (and 1 like it); fix one, give a prior, or add a run that tells them apart (`fdm design`)",
            "Table",
            "2 more remarks: --verbose",
        ];
        assert_eq!(shown, expected);
        assert!(first(&[]).is_empty() && lines(&all, true).len() == 7);
    }
}
