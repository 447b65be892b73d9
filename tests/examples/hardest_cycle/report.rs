//! What goes to the firmware, and what it says.

use super::search::{self, Found};
use cogmint::trace::feed;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// What the search left for the report, in `search.json`.
#[derive(Serialize, Deserialize)]
struct Search {
    search_seed: u64,
    searched: usize,
    cases: Vec<Case>,
}

#[derive(Serialize, Deserialize)]
struct Case {
    seed: u64,
    /// The cycle that was the hardest on the host.
    cycle: usize,
    host_seconds: f64,
    /// Hash over all state after every cycle, hexadecimal.
    hashes: Vec<String>,
}

/// One case in the firmware.
#[derive(Clone, Serialize)]
pub struct Run {
    seed: u64,
    cycle: usize,
    instructions: u64,
    host_seconds: f64,
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
    /// Where the search began.
    search_seed: u64,
    /// Number of cases that were run on the host.
    searched: usize,
    /// Those that were run on the target.
    runs: Vec<Run>,
}

/// Writes the worst cases as feeds that end with their hardest cycle.
///
/// # Errors
/// A sentence with the file.
pub fn write(out: &Path, search_seed: u64, found: &Found) -> Result<(), String> {
    let save = |path: &Path, bytes: &[u8]| {
        fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
    };
    let mut cases = Vec::new();
    for (number, tried) in found.worst.iter().enumerate() {
        let folder = out.join(format!("{}", number + 1));
        fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let (mut recording, setup) = search::build(tried.seed)?;
        recording.cycles.truncate(tried.hashes.len());
        let bytes = feed(&setup, &recording, Path::new("case")).map_err(|error| error.to_string())?;
        save(&folder.join("feed.bin"), &bytes)?;
        cases.push(Case {
            seed: tried.seed,
            cycle: tried.cycle,
            host_seconds: tried.seconds,
            hashes: tried.hashes.iter().map(|hash| format!("{hash:016x}")).collect(),
        });
    }
    let search = Search { search_seed, searched: found.searched, cases };
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
        search_seed: search.search_seed,
        searched: search.searched,
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
    let (cycle, instructions) =
        counts.into_iter().enumerate().max_by_key(|(_, count)| *count).ok_or("the case has no cycle")?;
    Ok(Run { seed: case.seed, cycle, instructions, host_seconds: case.host_seconds })
}

impl Report {
    /// Prints the report for people.
    pub fn print(&self) {
        println!("{:>18} {:>6} {:>14} {:>16}", "seed", "cycle", "instructions", "host ms");
        for run in &self.runs {
            println!(
                "{:>18} {:>6} {:>14} {:>16.1}",
                run.seed,
                run.cycle,
                run.instructions,
                1e3 * run.host_seconds
            );
        }
        println!(
            "\nhardest cycle {} instructions, of {} cases; --seed {} --seconds 0 re-creates it",
            self.instructions_max, self.searched, self.seed
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case() -> Case {
        let hashes = ["00000000000000aa", "00000000000000bb"].map(String::from).to_vec();
        Case { seed: 7, cycle: 1, host_seconds: 0.1, hashes }
    }

    const CYCLES: &str = "start stack 9\ncycle 0 hash 00000000000000aa 1 2 3 4 5 6 7 8\n\
                          cycle 1 hash 00000000000000bb 1 700000000 3 4 5 6 7 8\n";

    #[test]
    fn the_stages_of_the_hardest_cycle_add_up() {
        let run = hardest(&case(), &format!("{CYCLES}stack 10 tracker 20 frames 30\n")).unwrap();
        assert_eq!((run.cycle, run.instructions), (1, 700_000_034));
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
