use super::*;

/// A tensor of a file: name, type, shape, bytes.
type Entry = (String, &'static str, Vec<usize>, Vec<u8>);

fn metadata() -> BTreeMap<String, String> {
    NetworkInfo::default().metadata()
}

fn parameters() -> Parameters {
    Parameters::initial(NetworkInfo::default().architecture, 7)
}

fn entries(of: impl Fn(f32) -> Vec<u8>, dtype: &'static str) -> Vec<Entry> {
    let parameters = parameters();
    let entry = |(name, shape, values): (String, Vec<usize>, &[f32])| {
        let bytes = values.iter().flat_map(|value| of(*value)).collect();
        (name, dtype, shape, bytes)
    };
    parameters.tensors().into_iter().map(entry).collect()
}

fn plain() -> Vec<Entry> {
    entries(|value| value.to_le_bytes().to_vec(), "F32")
}

/// The bytes of a safetensors file, put together by hand.
fn file(entries: &[Entry], metadata: Option<&BTreeMap<String, String>>) -> Vec<u8> {
    let mut header = serde_json::Map::new();
    if let Some(metadata) = metadata {
        header.insert("__metadata__".to_owned(), serde_json::json!(metadata));
    }
    let mut data = Vec::new();
    for (name, dtype, shape, bytes) in entries {
        let offsets = [data.len(), data.len() + bytes.len()];
        data.extend_from_slice(bytes);
        header.insert(
            name.clone(),
            serde_json::json!({"dtype": dtype, "shape": shape, "data_offsets": offsets}),
        );
    }
    let header = serde_json::Value::Object(header).to_string();
    [
        &(header.len() as u64).to_le_bytes(),
        header.as_bytes(),
        &data,
    ]
    .concat()
}

fn error_of(entries: &[Entry]) -> String {
    let read = Parameters::from_safetensors(&file(entries, Some(&metadata())));
    read.unwrap_err().to_string()
}

#[test]
fn half_precision_is_widened() {
    let narrowed = entries(
        |value| half::f16::from_f32(value).to_le_bytes().to_vec(),
        "F16",
    );
    let (read, _) = Parameters::from_safetensors(&file(&narrowed, Some(&metadata()))).unwrap();
    let near = |a: &f32, b: &f32| (a - b).abs() <= 1e-3 * b.abs() + 1e-7;
    assert!(
        read.values()
            .iter()
            .zip(parameters().values())
            .all(|(a, b)| near(a, b))
    );
    let cut = entries(|value| value.to_le_bytes()[2..].to_vec(), "BF16");
    let (read, _) = Parameters::from_safetensors(&file(&cut, Some(&metadata()))).unwrap();
    for (found, whole) in read.values().iter().zip(parameters().values()) {
        assert_eq!(found.to_bits(), whole.to_bits() & 0xffff_0000);
    }
}

#[test]
fn prefixes_and_counters_of_pytorch_are_understood() {
    for prefix in [
        "module.",
        "_orig_mod.",
        "_orig_mod.module.",
        "module._orig_mod.",
    ] {
        let mut named = plain();
        for entry in &mut named {
            entry.0 = format!("{prefix}{}", entry.0);
        }
        let counter = format!("{prefix}initial.normalisation.num_batches_tracked");
        named.push((counter, "I64", vec![], vec![0; 8]));
        let (read, _) = Parameters::from_safetensors(&file(&named, Some(&metadata()))).unwrap();
        assert_eq!(read, parameters());
    }
    let mut twice = plain();
    let (name, dtype, shape, bytes) = twice[0].clone();
    twice.push((format!("module.{name}"), dtype, shape, bytes));
    assert!(error_of(&twice).contains(&format!("{name} is there twice")));
}

#[test]
fn missing_extra_and_misshapen_tensors_are_all_named() {
    let mut wrong = plain();
    let (first, _, _, _) = wrong.remove(0);
    let (second, _, _, _) = wrong.remove(0);
    wrong.push(("surplus.bias".to_owned(), "F32", vec![1], vec![0; 4]));
    wrong[0].2.push(1);
    let (third, shape) = (wrong[0].0.clone(), wrong[0].2.clone());
    let error = error_of(&wrong);
    for said in [
        format!("2 tensors are missing: {first}, {second}"),
        "1 tensor is not expected: surplus.bias".to_owned(),
        format!(
            "{third} is F32 {shape:?}, expected F32, F16 or BF16 {:?}",
            &shape[..shape.len() - 1]
        ),
    ] {
        assert!(error.contains(&said), "{said} is not in: {error}");
    }
    let error = error_of(&[]);
    assert!(
        error.contains("tensors are missing") && error.contains("more"),
        "{error}"
    );
    let whole = entries(|_| vec![0; 8], "F64");
    assert!(error_of(&whole).contains("is F64"), "{}", error_of(&whole));
}

#[test]
fn what_is_not_finite_is_named_with_its_tensor() {
    for value in [f32::NAN, f32::INFINITY] {
        let mut wrong = plain();
        wrong[3].3[4..8].copy_from_slice(&value.to_le_bytes());
        let error = error_of(&wrong);
        let said = format!("tensor {} holds {value} at 1, expected finite", wrong[3].0);
        assert!(error.contains(&said), "{error}");
    }
}

#[test]
fn a_file_without_metadata_is_told_what_to_give() {
    let error = Parameters::from_safetensors(&file(&plain(), None))
        .unwrap_err()
        .to_string();
    for key in metadata().keys() {
        assert!(error.contains(key.as_str()), "{key} is not in: {error}");
    }
    assert!(
        error.contains("save_file(tensors, file, metadata={"),
        "{error}"
    );
    let mut some = metadata();
    some.remove("cols");
    let (_, read) = Parameters::from_safetensors(&file(&plain(), Some(&some))).unwrap();
    let error = NetworkInfo::from_metadata(&read).unwrap_err().to_string();
    assert!(error.contains("the metadata has no cols."), "{error}");
}
