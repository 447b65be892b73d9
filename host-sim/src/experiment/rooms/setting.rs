//! A setting of the belief that is changed for an experiment: what each part of it is worth.

use cogmint_core::Config;
use std::fmt;
use std::str::FromStr;

/// A setting of the belief, or of its work, and its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeliefSetting {
    name: Name,
    value: f32,
}

/// Which setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Name {
    Turns,
    Elsewhere,
    SplitAbove,
    Outages,
    Returns,
    Comparisons,
    /// Work for each anchor heard.
    AnchorWork,
    /// Comparisons with one scan: how many components are carried where every anchor is heard.
    Components,
    WallsBarWays,
    WallsHidePaths,
    ReadsBelowThreshold,
}

impl Name {
    const ALL: [Self; 11] = [
        Self::Turns,
        Self::Elsewhere,
        Self::SplitAbove,
        Self::Outages,
        Self::Returns,
        Self::Comparisons,
        Self::AnchorWork,
        Self::Components,
        Self::WallsBarWays,
        Self::WallsHidePaths,
        Self::ReadsBelowThreshold,
    ];

    const fn as_str(self) -> &'static str {
        match self {
            Self::Turns => "turns_per_s",
            Self::Elsewhere => "elsewhere_per_s",
            Self::SplitAbove => "split_above_m",
            Self::Outages => "outages_per_s",
            Self::Returns => "returns_per_s",
            Self::Comparisons => "comparisons",
            Self::AnchorWork => "anchor_work",
            Self::Components => "components",
            Self::WallsBarWays => "walls_bar_ways",
            Self::WallsHidePaths => "walls_hide_paths",
            Self::ReadsBelowThreshold => "reads_below_threshold",
        }
    }
}

impl BeliefSetting {
    /// Changes the settings of a tracker that hears so many anchors. What is out of range is left for the core to refuse.
    pub fn apply(self, config: &mut Config, anchors: usize) {
        let Self { name, value } = self;
        let Config { belief: settings, work, .. } = config;
        match name {
            Name::Turns => settings.turns_per_s = value,
            Name::Elsewhere => settings.elsewhere_per_s = value,
            Name::SplitAbove => settings.split_above_m = value,
            Name::Outages => settings.outages_per_s = value,
            Name::Returns => settings.returns_per_s = value,
            // A cast that saturates.
            Name::Comparisons => work.comparisons = value as u16,
            Name::AnchorWork => work.anchor = value as u32,
            Name::Components => work.comparisons = (value * anchors as f32) as u16,
            Name::WallsBarWays => settings.walls_bar_ways = value != 0.0,
            Name::WallsHidePaths => settings.walls_hide_paths = value != 0.0,
            Name::ReadsBelowThreshold => settings.reads_below_threshold = value != 0.0,
        }
    }
}

impl FromStr for BeliefSetting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or("must be NAME=VALUE")?;
        let known = || Name::ALL.map(Name::as_str).join(", ");
        let found = Name::ALL.into_iter().find(|known| known.as_str() == name);
        let name = found.ok_or_else(|| format!("unknown setting {name:?} (known: {})", known()))?;
        let value: f32 = match value {
            "true" => 1.0,
            "false" => 0.0,
            _ => value.parse().map_err(|_| format!("{value:?} is no number"))?,
        };
        let (is_count, is_switch) = match name {
            Name::Comparisons | Name::Components => (true, false),
            Name::WallsBarWays | Name::WallsHidePaths | Name::ReadsBelowThreshold => (false, true),
            _ => (false, false),
        };
        if is_count && !(value >= 1.0 && value <= f32::from(u16::MAX) && value.fract() == 0.0) {
            return Err(format!("{} must be a whole number from 1 to {}", name.as_str(), u16::MAX));
        }
        if is_switch && value != 0.0 && value != 1.0 {
            return Err(format!("{} must be true or false", name.as_str()));
        }
        Ok(Self { name, value })
    }
}

impl fmt::Display for BeliefSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.name.as_str(), self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_read_and_changes_itself_alone() {
        let usual = Config::default();
        let mut seen = Vec::new();
        for name in Name::ALL {
            let value = match name {
                Name::WallsBarWays | Name::WallsHidePaths | Name::ReadsBelowThreshold => 0.0,
                _ => 3.0,
            };
            let text = format!("{}={value}", name.as_str());
            let setting: BeliefSetting = text.parse().expect("it is one");
            assert_eq!(setting.to_string(), text);
            let mut changed = usual;
            setting.apply(&mut changed, 2);
            assert!(changed != usual && !seen.contains(&changed), "{text}");
            seen.push(changed);
        }
        assert_eq!("walls_bar_ways=false".parse::<BeliefSetting>(), "walls_bar_ways=0".parse());
        let mut changed = usual;
        BeliefSetting { name: Name::Components, value: 8.0 }.apply(&mut changed, 4);
        assert_eq!(changed.work.comparisons, 32);
    }

    #[test]
    fn what_is_no_setting_is_refused_with_a_sentence() {
        for (text, why) in [
            ("turns_per_s", "must be NAME=VALUE"),
            ("turns=1", "unknown setting"),
            ("turns_per_s=fast", "is no number"),
            ("components=0", "whole number"),
            ("comparisons=2.5", "whole number"),
            ("comparisons=NaN", "whole number"),
            ("walls_bar_ways=2", "must be true or false"),
        ] {
            let refused = text.parse::<BeliefSetting>().expect_err(text);
            assert!(refused.contains(why), "{text}: {refused}");
        }
    }
}
