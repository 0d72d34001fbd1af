// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   foreign FILE TYPE:PATH...
//
// Prints what hdf5-pure, an HDF5 reader in Rust, reads of a bundle: a JSON object from path to a flat
// list of numbers or texts. TYPE is f8, i4, u1 or text; "/group@name" is an attribute.
use hdf5_pure::{AttrValue, File};
use std::error::Error;

fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.trim_end_matches('\0').chars() {
        if c == '"' || c == '\\' {
            quoted.push('\\');
        }
        quoted.push(c);
    }
    quoted + "\""
}

fn numbers<T: std::fmt::Debug>(values: Vec<T>) -> Vec<String> {
    // `Debug` prints the shortest decimal number that gives the same bits.
    values.iter().map(|value| format!("{value:?}")).collect()
}

fn attribute(file: &File, group: &str, name: &str) -> Result<Vec<String>, Box<dyn Error>> {
    let attributes = if group == "/" {
        file.root().attrs()?
    } else {
        match file.group(group) {
            Ok(found) => found.attrs()?,
            Err(_) => file.dataset(group)?.attrs()?,
        }
    };
    match attributes.get(name) {
        Some(AttrValue::F64(value)) => Ok(numbers(vec![*value])),
        Some(AttrValue::I32(value)) => Ok(numbers(vec![*value])),
        Some(AttrValue::U8(value)) => Ok(numbers(vec![*value])),
        Some(AttrValue::String(value)) => Ok(vec![quoted(value)]),
        Some(AttrValue::StringSized { value, .. }) => Ok(vec![quoted(value)]),
        other => Err(format!("{group}@{name} is {other:?}").into()),
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let file = File::open(&words[0])?;
    let mut parts = Vec::new();
    for word in &words[1..] {
        let (kind, path) = word.split_once(':').ok_or("TYPE:PATH is wanted")?;
        let values = if let Some((group, name)) = path.split_once('@') {
            attribute(&file, group, name)?
        } else {
            let dataset = file.dataset(path)?;
            match kind {
                "f8" => numbers(dataset.read_f64()?),
                "i4" => numbers(dataset.read_i32()?),
                "u1" => numbers(dataset.read_u8()?),
                _ => dataset.read_string()?.iter().map(|text| quoted(text)).collect(),
            }
        };
        parts.push(format!("{}: [{}]", quoted(path), values.join(", ")));
    }
    println!("{{{}}}", parts.join(", "));
    Ok(())
}
