//! `stonecut status`: what a job folder holds.

use crate::error::{Error, Result};
use crate::store::job::view;
use crate::system::json_keys::{SCHEMA_VERSION, add_old_names};
use crate::system::paths::{Paths, Role};
use std::io::Write;
use std::path::PathBuf;

/// Tells what a job folder belongs to and which stages are done.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The job folder, OUTPUT.stonecut-job by default.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Args {
    pub(super) fn paths(&self) -> Paths {
        Paths::default().with(Role::InputFolder, "JOBDIR", &self.folder)
    }
}

/// Prints the status on standard output.
pub fn run(args: &Args) -> Result<()> {
    let state = view(&args.folder)?;
    let done: Vec<&String> = state.outcomes.keys().collect();
    let text = if args.json {
        let mut settings = state.identity.settings.clone();
        let mut marks = state.identity.input_marks.clone();
        add_old_names(&mut settings);
        add_old_names(&mut marks);
        let json = serde_json::json!({
            "schema_version": SCHEMA_VERSION,
            "version": env!("CARGO_PKG_VERSION"),
            "input": state.identity.input,
            "input_fingerprint": state.identity.input_marks,
            "input_marks": marks,
            "settings": settings,
            "stages_done": done,
            "outcomes": state.outcomes,
        });
        format!("{json:#}\n")
    } else {
        let mut text = format!("input   {}\n", state.identity.input);
        for (name, value) in &state.identity.settings {
            text += &format!("{name:15} {value}\n");
        }
        text += &match done.as_slice() {
            [] => "done    nothing yet\n".to_owned(),
            names => {
                let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
                format!("done    {}\n", names.join(", "))
            }
        };
        text + "continue by running the same command again\n"
    };
    std::io::stdout().write_all(text.as_bytes()).map_err(Error::stdout)
}
