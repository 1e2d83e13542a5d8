//! Results of all kinds, as they were before they had types: each is read into its document and written again to the same bytes.

use super::design::Design;
use super::profile::Profile;
use super::reproduction::Outcome;
use super::study::Study;
use super::{
    DiagnosisDocument, EffectsDocument, ModelDocument, ModesDocument, OutputDocument, RecursiveDocument,
    ResponseDocument, ResultDocument, SpectraDocument, StructureDocument, from_text, to_text,
};
use crate::comparison::Comparison;
use std::error::Error;
use std::fs;

fn again<T: serde::Serialize + serde::de::DeserializeOwned>(text: &str) -> Result<String, Box<dyn Error>> {
    Ok(to_text(&from_text::<T>(text)?)?)
}

/// The kind is what the name of a file begins with.
fn written_again(kind: &str, text: &str) -> Result<String, Box<dyn Error>> {
    match kind {
        "fit" | "filter" | "spectra" | "responses" | "regress" | "study" | "validate" => {
            Ok(ResultDocument::read(text)?.text()?)
        }
        "structure" => again::<StructureDocument>(text),
        "recursive" => again::<RecursiveDocument>(text),
        "records" => again::<SpectraDocument>(text),
        "profile" => again::<Vec<Profile>>(text),
        "modes" => again::<ModesDocument>(text),
        "design" => again::<Design>(text),
        "diagnose" => again::<DiagnosisDocument>(text),
        "compare" => again::<Comparison>(text),
        "reproduce" => again::<Vec<Outcome>>(text),
        "repeats" => again::<Vec<Study>>(text),
        "simulate" => again::<Vec<ResponseDocument>>(text),
        "check" => again::<ModelDocument>(text),
        "effects" => again::<EffectsDocument>(text),
        "quality" => again::<Vec<OutputDocument>>(text),
        _ => Err(format!("a document of an unknown kind: {kind}").into()),
    }
}

#[test]
fn every_document_comes_back_to_the_byte() {
    let (mut count, mut wrong) = (0, Vec::new());
    for entry in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/documents")).unwrap() {
        let path = entry.unwrap().path();
        let (name, text) =
            (path.file_stem().unwrap().to_string_lossy().into_owned(), fs::read_to_string(&path).unwrap());
        count += 1;
        match written_again(name.split('_').next().unwrap_or_default(), &text) {
            Ok(again) if again == text => {}
            Ok(again) => {
                let at = again.bytes().zip(text.bytes()).take_while(|(a, b)| a == b).count();
                let around = |text: &str| text[at.saturating_sub(60)..].chars().take(120).collect::<String>();
                wrong.push(format!("{name}: byte {at}\n  was {}\n  is  {}", around(&text), around(&again)));
            }
            Err(e) => wrong.push(format!("{name}: {e}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count >= 40, "{count} documents");
}
