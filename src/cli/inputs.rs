//! The paths of commands that read one mesh and write something: inputs, and last the output.

use crate::io::InputPaths;
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use std::path::PathBuf;

/// The name of the argument.
const ID: &str = "paths";

/// Inputs that become one mesh, and the output.
#[derive(Clone, Debug)]
pub struct InOut {
    /// One file or several, folders, lists.
    pub input: InputPaths,
    /// The last path.
    pub output: PathBuf,
}

impl Args for InOut {
    fn augment_args(command: Command) -> Command {
        command.arg(
            Arg::new(ID)
                .value_name("INPUT>... <OUTPUT")
                .required(true)
                .action(ArgAction::Append)
                .value_parser(clap::value_parser!(PathBuf))
                .help("The mesh, and last the path of the result; several files, folders and lists (@list.txt) become one mesh"),
        )
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for InOut {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let paths = matches.get_many::<PathBuf>(ID).into_iter().flatten();
        let mut paths: Vec<PathBuf> = paths.cloned().collect();
        // Two meshes are compared, or one is read and one written.
        let (missing, example) = match matches.try_contains_id("samples") {
            Ok(true) => ("simplified mesh", "stonecut measure scan.ply small.ply"),
            _ => ("path of the result", "scan.ply small.ply"),
        };
        match paths.pop() {
            Some(output) if !paths.is_empty() => {
                let memory = matches.try_get_one("memory").ok().flatten().copied();
                let skips = matches.try_get_one("skip_bad").ok().flatten().copied();
                let input = InputPaths::from(paths).within(memory);
                Ok(InOut { input: input.skipping_missing(skips.unwrap_or(false)), output })
            }
            only => {
                let only = only.unwrap_or_default();
                let what = format!(
                    "{} is the only path that was given: the {missing} comes last and is missing; for example: {example}",
                    only.display()
                );
                Err(clap::Error::raw(ErrorKind::MissingRequiredArgument, what))
            }
        }
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
