//! A line-spectral method that runs in a program of its own, so that published implementations in other languages can
//! be measured on the same responses.
//!
//! The program reads one JSON object per line and answers each with a JSON list of delays in seconds, before reading on:
//! `{"step_hz": 1e7, "paths": 16, "lines": [[re, im], ...]}`. The lines are the frame's frequency samples over the
//! pulse's, in increasing frequency, so that a path of delay tau turns by -2 pi step_hz tau from each to the next. Joint
//! amplitudes and the threshold on what it finds, with the level around each path, are the same as for `esprit-local`.

use super::super::estimator::{Found, PATHS, PathFinder};
use super::frame::{Frame, Radio};
use super::level::LevelModel;
use super::line_spectrum::LineSpectrum;
use crate::input_error::{InputError, in_one_line};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A running program.
pub struct Program {
    path: PathBuf,
    spectrum: LineSpectrum,
    level: LevelModel,
    talk: Mutex<Talk>,
}

struct Talk {
    child: Child,
    /// `None` once it is to end.
    questions: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    failure: Option<String>,
}

#[derive(serde::Serialize)]
struct Question {
    step_hz: f64,
    paths: usize,
    lines: Vec<[f64; 2]>,
}

impl Program {
    /// Starts the program.
    ///
    /// # Errors
    ///
    /// When it cannot be started.
    pub fn start(path: &Path) -> Result<Self, InputError> {
        let failed = |reason: String| {
            InputError::new(path, reason).for_item("--against-program").allowed("a program that can be run")
        };
        let start = Command::new(path).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child =
            start.map_err(|error| failed(format!("cannot be started: {}", in_one_line(error))))?;
        let (Some(questions), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(failed("cannot be talked to".into()));
        };
        let spectrum = LineSpectrum::new(Radio::of_the_experiment(), super::super::estimator::SAMPLES);
        let answers = BufReader::new(answers);
        let talk = Mutex::new(Talk { child, questions: Some(questions), answers, failure: None });
        Ok(Self { path: path.to_owned(), spectrum, level: LevelModel::LocalMean, talk })
    }

    /// What went wrong since it was started: what was found from then on counts for nothing.
    pub fn failure(&self) -> Option<String> {
        let failure = self.talk().failure.clone();
        failure.map(|reason| format!("{}: {reason}", self.path.display()))
    }

    fn talk(&self) -> MutexGuard<'_, Talk> {
        self.talk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PathFinder for Program {
    fn name(&self) -> &str {
        self.path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("program")
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let frame = Frame::new(self.spectrum.radio(), samples);
        let lines = self.spectrum.of(&frame).iter().map(|line| [line.re, line.im]).collect();
        let question = Question { step_hz: self.spectrum.step_hz(), paths: PATHS, lines };
        let delays_s = {
            let mut talk = self.talk();
            if talk.failure.is_some() {
                return Vec::new();
            }
            match talk.ask(&question) {
                Ok(delays_s) => delays_s,
                Err(reason) => {
                    talk.failure = Some(reason);
                    return Vec::new();
                }
            }
        };
        self.spectrum.paths(&frame, &delays_s, self.level, false_paths)
    }
}

impl Talk {
    fn ask(&mut self, question: &Question) -> Result<Vec<f64>, String> {
        let text = serde_json::to_string(question).map_err(in_one_line)?;
        let Some(questions) = &mut self.questions else { return Err("was ended".into()) };
        writeln!(questions, "{text}").and_then(|()| questions.flush()).map_err(|_| "ended early")?;
        let mut answer = String::new();
        let read = self.answers.read_line(&mut answer).map_err(in_one_line)?;
        if read == 0 {
            return Err("ended without an answer".into());
        }
        serde_json::from_str(&answer)
            .map_err(|error| format!("did not answer with a list of delays: {}", in_one_line(error)))
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let talk = self.talk.get_mut().unwrap_or_else(PoisonError::into_inner);
        // The end of its input ends it.
        talk.questions = None;
        let _ = talk.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_not_there_is_named() {
        let error = Program::start(Path::new("no/such/program")).map(|_| ()).expect_err("it is not there");
        assert!(
            error.to_string().starts_with("no/such/program: `--against-program` cannot be started"),
            "{error}"
        );
    }

    #[test]
    fn a_program_that_does_not_answer_is_a_failure_and_finds_nothing() {
        let program = Program::start(Path::new("true")).expect("it is part of every system");
        assert!(program.find(&[[1.0, 0.0]; 400], 0.01).is_empty());
        assert!(program.failure().is_some_and(|reason| reason.starts_with("true: ended")));
    }

    /// `cat` answers with the question, which is no list.
    #[test]
    fn an_answer_that_is_no_list_is_a_failure() {
        let program = Program::start(Path::new("cat")).expect("it is part of every system");
        assert!(program.find(&[[1.0, 0.0]; 400], 0.01).is_empty());
        assert!(program.failure().is_some_and(|reason| reason.contains("list of delays")));
    }
}
