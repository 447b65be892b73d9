//! Writes the C header of cogmint-c to the file named. To be run in the folder of that crate: see `header.sh`.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let to = std::env::args().nth(1).ok_or("which file is to be written?")?;
    let config = cbindgen::Config::from_file("cbindgen.toml")?;
    // Its modules follow by their declarations.
    let made = cbindgen::Builder::new().with_config(config).with_src("src/lib.rs").generate()?;
    made.write_to_file(to);
    Ok(())
}
