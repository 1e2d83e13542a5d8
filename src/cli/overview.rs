//! The first help: verbs in groups, each with the line of its own definition. clap lists subcommands under one heading only.

use clap::Command;

/// Groups of verbs: a heading, and the verb with which the group begins.
const GROUPS: [(&str, &str); 3] =
    [("Commands", "new"), ("Methods and results", "regress"), ("Language and tools", "effects")];

/// What stands below the options.
pub(crate) const ADVICE: &str =
    "`fdm COMMAND -h` shows the options that are used most, `fdm COMMAND --help` all of them.";

/// The first help of a command, as a template of clap.
pub(crate) fn template(command: &Command) -> String {
    let (title, literal) = (command.get_styles().get_header(), command.get_styles().get_literal());
    let longest = command.get_subcommands().map(|verb| verb.get_name().len()).max().unwrap_or_default();
    let mut text = String::from("{about-with-newline}\n{usage-heading} {usage}\n");
    for verb in command.get_subcommands() {
        let name = verb.get_name();
        if let Some((heading, _)) = GROUPS.iter().find(|(_, first)| *first == name) {
            text.push_str(&format!("\n{title}{heading}:{title:#}\n"));
        }
        let about = verb.get_about().map(ToString::to_string).unwrap_or_default();
        let gap = " ".repeat(longest - name.len() + 2);
        text.push_str(&format!("  {literal}{name}{literal:#}{gap}{about}\n"));
    }
    text.push_str(&format!("\n{title}Options:{title:#}\n{{options}}{{after-help}}"));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_verbs_come_first_and_each_has_one_short_line() {
        let command = crate::command();
        let verbs: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
        let begins = GROUPS.map(|(_, first)| verbs.iter().position(|verb| *verb == first));
        assert_eq!(begins, [Some(0), Some(12), Some(22)], "{verbs:?}");
        let help = command.clone().render_help().to_string();
        for verb in &verbs {
            let line = help.lines().find(|line| line.trim_start().starts_with(&format!("{verb} ")));
            assert!(line.is_some_and(|line| line.chars().count() <= 80), "{verb}: {line:?}");
        }
    }
}
