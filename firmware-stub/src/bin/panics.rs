//! A planted failure: a program with a reachable panic, which must not link. Only `tests/target_meters.sh` tries it.

#![no_std]
#![no_main]

use cogmint_board::host::{self, File, Line};
use cortex_m_rt::entry;

#[entry]
fn main() -> ! {
    let mut bytes = [1; 4];
    if let Some(mut feed) = File::open_feed() {
        feed.read(&mut bytes);
    }
    let [index, ..] = bytes;
    Line::new().decimal(u32::from(bytes[usize::from(index)])).end();
    host::end(Ok(()))
}
