//! `cogmint scenario`: checks and shows scenarios.

use super::{print, print_json};
use crate::Failure;
use cogmint::input_error::InputError;
use cogmint::scenario::{BUILT_IN, Scenario, Way};

#[derive(clap::Subcommand)]
pub enum Action {
    /// Check a scenario's file.
    Check {
        /// The file, or a built-in scenario's name.
        file: String,
    },
    /// List the built-in scenarios.
    List,
    /// Print the file of a built-in scenario, to start from.
    Show {
        /// Its name.
        name: String,
    },
    /// Print the JSON schema of the files.
    Schema,
}

pub fn run(action: &Action) -> Result<(), Failure> {
    match action {
        Action::Check { file } => {
            let (scenario, folder) = Scenario::find(file)?;
            for (index, trajectory) in scenario.trajectories.iter().enumerate() {
                if let Way::Recorded { .. } = trajectory.way {
                    cogmint::channel::poses(&scenario, folder.as_deref(), index)?;
                }
            }
            print(&format!(
                "{file}: is a valid scenario: {}; walls: {}, anchors: {}, trajectories: {}, actions: {}.",
                scenario.name,
                cogmint::scenario::walls(&scenario.room).len(),
                scenario.anchors.len(),
                scenario.trajectories.len(),
                scenario.radio.actions().len(),
            ));
        }
        Action::List => {
            for built_in in BUILT_IN {
                print(&format!("{:<18} {}", built_in.name, built_in.summary));
            }
        }
        Action::Show { name } => {
            let Some(built_in) = BUILT_IN.iter().find(|built_in| built_in.name == name) else {
                let names = BUILT_IN.map(|built_in| built_in.name).join(", ");
                return Err(InputError::new(name, "is no built-in scenario").allowed(names).into());
            };
            print(built_in.text.trim_end());
        }
        Action::Schema => print_json(Scenario::schema())?,
    }
    Ok(())
}
