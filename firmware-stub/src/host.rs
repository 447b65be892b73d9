//! The debugger's host: lines out, bytes of the feed in, and the end. Without `core::fmt`, whose code would
//! count as the core's.

use crate::meter::Instructions;
use cortex_m_semihosting::{nr, syscall};

const STDOUT_NAME: &[u8] = b":tt\0";
const FEED_NAME: &[u8] = b"feed.bin\0";
/// Modes of the semihosting call that opens a file.
const READ_BINARY: usize = 1;
const WRITE: usize = 4;
const WRITE_BINARY: usize = 5;

/// Writes to the host's standard output.
pub fn write(bytes: &[u8]) {
    // SAFETY: the arguments are those the call expects, and the buffers outlive it.
    unsafe {
        let handle = syscall!(OPEN, STDOUT_NAME.as_ptr() as usize, WRITE, STDOUT_NAME.len() - 1);
        syscall!(WRITE, handle, bytes.as_ptr() as usize, bytes.len());
    }
}

/// Why a run ended early: a line for the host, its end included.
#[derive(Clone, Copy)]
pub struct Fault(pub &'static [u8]);

impl Fault {
    /// There is no feed, or one that is malformed.
    pub const FEED: Self = Self(b"error no feed, or a malformed one\n");
}

/// Ends the run with its outcome.
pub fn end(outcome: Result<(), Fault>) -> ! {
    if let Err(Fault(line)) = outcome {
        write(line);
    }
    exit(outcome.is_ok())
}

fn exit(success: bool) -> ! {
    /// ADP_Stopped_ApplicationExit and ADP_Stopped_RunTimeErrorUnknown.
    const REASONS: [usize; 2] = [0x2_0026, 0x2_0023];
    loop {
        // SAFETY: the call takes its reason as the argument itself.
        unsafe {
            cortex_m_semihosting::syscall1(
                nr::REPORT_EXCEPTION,
                if success { REASONS[0] } else { REASONS[1] },
            );
        }
    }
}

/// A file on the host, read from its beginning.
pub struct File {
    handle: usize,
}

impl File {
    /// Opens the feed: `feed.bin` in the folder that the debugger was started in.
    pub fn open_feed() -> Option<Self> {
        Self::open(FEED_NAME)
    }

    /// Opens a file in that folder; `name` ends with a zero.
    pub fn open(name: &'static [u8]) -> Option<Self> {
        // SAFETY: the arguments are those the call expects.
        let handle = unsafe { syscall!(OPEN, name.as_ptr() as usize, READ_BINARY, name.len() - 1) };
        if handle == usize::MAX { None } else { Some(Self { handle }) }
    }

    /// How many bytes it has.
    pub fn length(&self) -> usize {
        // SAFETY: the argument is the one the call expects.
        unsafe { syscall!(FLEN, self.handle) }
    }

    /// Fills `bytes`; false at the file's end.
    pub fn read(&mut self, bytes: &mut [u8]) -> bool {
        // SAFETY: the arguments are those the call expects, and the buffer outlives it.
        let missing = unsafe { syscall!(READ, self.handle, bytes.as_mut_ptr() as usize, bytes.len()) };
        missing == 0
    }
}

/// Writes a file in the folder that the debugger was started in; `name` ends with a zero. False where it cannot be written.
pub fn write_file(name: &'static [u8], bytes: &[u8]) -> bool {
    // SAFETY: the arguments are those the calls expect, and the buffer outlives them.
    unsafe {
        let handle = syscall!(OPEN, name.as_ptr() as usize, WRITE_BINARY, name.len() - 1);
        if handle == usize::MAX {
            return false;
        }
        let missing = syscall!(WRITE, handle, bytes.as_ptr() as usize, bytes.len());
        syscall!(CLOSE, handle);
        missing == 0
    }
}

/// One line of output, assembled before it is written.
pub struct Line {
    bytes: [u8; 256],
    length: usize,
}

impl Default for Line {
    fn default() -> Self {
        Self::new()
    }
}

impl Line {
    /// An empty line.
    pub fn new() -> Self {
        Self { bytes: [0; 256], length: 0 }
    }

    fn push(&mut self, byte: u8) {
        if let Some(slot) = self.bytes.get_mut(self.length) {
            *slot = byte;
            self.length += 1;
        }
    }

    /// Appends text.
    pub fn text(&mut self, text: &[u8]) -> &mut Self {
        for byte in text {
            self.push(*byte);
        }
        self
    }

    /// Appends a number in decimal.
    pub fn decimal(&mut self, number: u32) -> &mut Self {
        let mut divisor = 1_000_000_000;
        let mut started = false;
        while divisor > 0 {
            let digit = (number / divisor % 10) as u8;
            started |= digit != 0 || divisor == 1;
            if started {
                self.push(b'0' + digit);
            }
            divisor /= 10;
        }
        self
    }

    /// Appends a number of instructions in decimal.
    pub fn instructions(&mut self, count: Instructions) -> &mut Self {
        let (billions, rest) = count.parts();
        if billions == 0 {
            return self.decimal(rest);
        }
        self.decimal(billions);
        // Nine digits, zeros included.
        let mut divisor = 100_000_000;
        while divisor > 0 {
            self.push(b'0' + (rest / divisor % 10) as u8);
            divisor /= 10;
        }
        self
    }

    /// Appends a number in 16 hexadecimal digits.
    pub fn hex(&mut self, number: u64) -> &mut Self {
        for nibble in (0..16).rev() {
            let digit = (number >> (4 * nibble)) as u8 & 0xf;
            self.push(if digit < 10 { b'0' + digit } else { b'a' + digit - 10 });
        }
        self
    }

    /// Writes the line.
    pub fn end(&mut self) {
        self.push(b'\n');
        if let Some(bytes) = self.bytes.get(..self.length) {
            write(bytes);
        }
        self.length = 0;
    }
}
