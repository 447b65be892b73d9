//! What goes to the firmware, and what it says.

use super::search::{self, Extent, Found};
use cogmint::trace::feed;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// How far work and instructions may be from each other, as a share of the instructions.
const AGREED: f64 = 0.2;

/// What the search left for the report, in `search.json`.
#[derive(Serialize, Deserialize)]
struct Search {
    search_seed: u64,
    uncapped: bool,
    searched: usize,
    cycles: u64,
    cases: Vec<Case>,
}

#[derive(Serialize, Deserialize)]
struct Case {
    seed: u64,
    /// Work of every cycle, the last of which was the hardest.
    work: Vec<u32>,
    /// Hash over all state after every cycle, hexadecimal.
    hashes: Vec<String>,
}

/// One case in the firmware.
#[derive(Clone, Serialize)]
pub struct Run {
    seed: u64,
    /// The cycle that took most instructions, from 0.
    cycle: usize,
    instructions: u64,
    work: u32,
    /// The largest difference of work and instructions over these, of this cycle and of the one with most work.
    disagreement: f64,
}

/// The hardest cycle.
#[derive(Serialize)]
pub struct Report {
    /// Instructions of the hardest cycle on the target.
    pub instructions_max: u64,
    /// What re-creates its case.
    pub seed: u64,
    /// The cycle of that case, from 0.
    cycle: usize,
    /// The largest difference of work and instructions, over these.
    disagreement_max: f64,
    /// Where the search began, and whether without caps.
    search_seed: u64,
    uncapped: bool,
    /// Number of cases that were run on the host, and of their cycles.
    searched: usize,
    cycles: u64,
    /// Those that were run on the target.
    runs: Vec<Run>,
}

/// Writes the worst cases as feeds that end with their hardest cycle.
///
/// # Errors
/// A sentence with the file.
pub fn write(out: &Path, search_seed: u64, extent: &Extent, found: &Found) -> Result<(), String> {
    let save = |path: &Path, bytes: &[u8]| {
        fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
    };
    let uncapped = extent.is_uncapped;
    let mut cases = Vec::new();
    for (number, tried) in found.worst.iter().enumerate() {
        let folder = out.join(format!("{}", number + 1));
        fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let (mut recording, setup) = search::build(tried.seed, uncapped)?;
        recording.cycles.truncate(tried.hashes.len());
        let bytes = feed(&setup, &recording, Path::new("case")).map_err(|error| error.to_string())?;
        save(&folder.join("feed.bin"), &bytes)?;
        let hashes = tried.hashes.iter().map(|hash| format!("{hash:016x}")).collect();
        cases.push(Case { seed: tried.seed, work: tried.work.clone(), hashes });
    }
    let search = Search { search_seed, uncapped, searched: found.searched, cycles: found.cycles, cases };
    save(&out.join("search.json"), &serde_json::to_vec(&search).map_err(|error| error.to_string())?)
}

/// Reads what the firmware said of every case.
///
/// # Errors
/// A sentence: the firmware ended with an error, its state is not the host's, or there is no case.
pub fn read(out: &Path) -> Result<Report, String> {
    let text = |path: &Path| fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()));
    let search: Search =
        serde_json::from_str(&text(&out.join("search.json"))?).map_err(|error| error.to_string())?;
    let mut runs = Vec::new();
    for (number, case) in search.cases.iter().enumerate() {
        let log = text(&out.join(format!("{}/target.txt", number + 1)))?;
        runs.push(hardest(case, &log).map_err(|reason| format!("case {}: {reason}", case.seed))?);
    }
    let hardest = runs.iter().max_by_key(|run| run.instructions).cloned().ok_or("no case was searched")?;
    Ok(Report {
        instructions_max: hardest.instructions,
        seed: hardest.seed,
        cycle: hardest.cycle,
        disagreement_max: runs.iter().map(|run| run.disagreement).fold(0.0, f64::max),
        search_seed: search.search_seed,
        uncapped: search.uncapped,
        searched: search.searched,
        cycles: search.cycles,
        runs,
    })
}

/// The hardest cycle of a case in the firmware's log.
fn hardest(case: &Case, log: &str) -> Result<Run, String> {
    let mut counts = Vec::new();
    let mut has_ended = false;
    for line in log.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["cycle", _, "hash", hash, stages @ ..] => {
                if case.hashes.get(counts.len()).map(String::as_str) != Some(hash) {
                    return Err(format!(
                        "the firmware's state is not the host's after cycle {}",
                        counts.len()
                    ));
                }
                let stages = stages.iter().map(|count| count.parse::<u64>());
                counts.push(stages.sum::<Result<u64, _>>().map_err(|error| error.to_string())?);
            }
            ["stack", ..] => has_ended = true,
            ["error", ..] => return Err(format!("the firmware said: {line}")),
            _ => {}
        }
    }
    if !has_ended || counts.len() != case.hashes.len() {
        return Err(format!("the firmware ended after {} of {} cycles", counts.len(), case.hashes.len()));
    }
    let of = |cycle: usize| (cycle, counts[cycle], case.work[cycle]);
    let apart =
        |(_, instructions, work): (usize, u64, u32)| (f64::from(work) / instructions as f64 - 1.0).abs();
    let last = of(counts.len().checked_sub(1).ok_or("the case has no cycle")?);
    let longest = (0..counts.len()).map(of).max_by_key(|(_, count, _)| *count).unwrap_or(last);
    let (cycle, instructions, work) = longest;
    let disagreement = apart(longest).max(apart(last));
    Ok(Run { seed: case.seed, cycle, instructions, work, disagreement })
}

impl Report {
    /// Prints the report for people.
    pub fn print(&self) {
        println!("{:>18} {:>6} {:>14} {:>14} {:>8}", "seed", "cycle", "instructions", "work", "apart");
        for run in &self.runs {
            let Run { seed, cycle, instructions, work, disagreement } = run;
            println!("{seed:>18} {cycle:>6} {instructions:>14} {work:>14} {:>6.1} %", 100.0 * disagreement);
        }
        println!(
            "\nhardest cycle {} instructions, of {} cycles in {} cases{}; work and instructions differ by {:.1} % at most; --seed {} \
             --seconds 0 re-creates it",
            self.instructions_max,
            self.cycles,
            self.searched,
            if self.uncapped { " without caps" } else { "" },
            100.0 * self.disagreement_max,
            self.seed
        );
    }

    /// Checks that what the search is ranked by is what a cycle costs.
    ///
    /// # Errors
    /// A sentence: work and instructions do not agree.
    pub fn check(&self) -> Result<(), String> {
        if self.disagreement_max <= AGREED {
            return Ok(());
        }
        Err(format!(
            "work and instructions differ by {:.1} %, allowed are {:.0} %",
            100.0 * self.disagreement_max,
            100.0 * AGREED
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case() -> Case {
        let hashes = ["00000000000000aa", "00000000000000bb"].map(String::from).to_vec();
        Case { seed: 7, work: vec![30, 600_000_000], hashes }
    }

    const CYCLES: &str = "start stack 9\ncycle 0 hash 00000000000000aa 1 2 3 4 5 6 7 8\n\
                          cycle 1 hash 00000000000000bb 1 700000000 3 4 5 6 7 8\n";

    #[test]
    fn the_stages_of_the_hardest_cycle_add_up() {
        let run = hardest(&case(), &format!("{CYCLES}stack 10 tracker 20 frames 30\n")).unwrap();
        assert_eq!((run.cycle, run.instructions, run.work), (1, 700_000_034, 600_000_000));
        assert!((run.disagreement - 1.0 / 7.0).abs() < 1e-6, "{}", run.disagreement);
    }

    #[test]
    fn work_that_is_not_what_a_cycle_costs_fails() {
        let folder = cogmint_tests::Folder::new("hardest-cycle");
        let report = |work: u32| {
            let case = Case { work: vec![36, work], ..case() };
            let search =
                Search { search_seed: 7, uncapped: false, searched: 1, cycles: 2, cases: vec![case] };
            fs::write(folder.path().join("search.json"), serde_json::to_vec(&search).unwrap()).unwrap();
            fs::create_dir_all(folder.path().join("1")).unwrap();
            fs::write(folder.path().join("1/target.txt"), format!("{CYCLES}stack 1 tracker 2 frames 3\n"))
                .unwrap();
            read(folder.path()).unwrap()
        };
        assert!(report(600_000_000).check().is_ok() && report(800_000_000).check().is_ok());
        assert!(report(500_000_000).check().unwrap_err().contains("28.6 %"));
        assert!(report(900_000_000).check().is_err());
    }

    #[test]
    fn a_firmware_that_fails_or_disagrees_gives_no_figure() {
        let says = |log: &str| hardest(&case(), log).err().unwrap();
        assert!(says(&format!("{CYCLES}error the stack is used up\n")).contains("the stack is used up"));
        assert!(says(CYCLES).contains("ended after 2 of 2"));
        assert!(says("cycle 0 hash 00000000000000ab 1\n").contains("not the host's after cycle 0"));
        assert!(says("stack 10 tracker 20 frames 30\n").contains("0 of 2 cycles"));
    }
}
