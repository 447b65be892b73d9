//! The named action libraries, as options.

use cogmint::scenario::{Library, NamedLibrary};

/// Carriers to choose from.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum Carriers {
    Published,
    Wide,
    Dw1000,
    Dw3000,
    HrpEurope,
}

impl Carriers {
    /// As a scenario names it.
    pub fn library(self) -> Library {
        Library::Named(match self {
            Self::Published => NamedLibrary::Published,
            Self::Wide => NamedLibrary::Wide,
            Self::Dw1000 => NamedLibrary::Dw1000,
            Self::Dw3000 => NamedLibrary::Dw3000,
            Self::HrpEurope => NamedLibrary::HrpEurope,
        })
    }
}
