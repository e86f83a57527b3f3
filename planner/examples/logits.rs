//! Writes the inputs and logits of a network on a made-up frame, for comparison with other runtimes:
//! `logits WEIGHTS FOLDER` leaves `planes`, `features` (for `enet-shared`) and `logits` there as raw
//! floats, channels first, each with its shape in a text file beside it.

use std::error::Error;
use std::path::Path;

use candle_core::{Device, Tensor};
use swath_bridge::{Cell, Pose2};
use swath_planner::Plane;
use swath_planner::network::{
    Architecture, Differentiable, Encoding, INPUT_PLANES, NetworkInfo, Parameters, SIDE_MULTIPLE,
    Surroundings,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(weights), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: logits WEIGHTS FOLDER".into());
    };
    let folder = Path::new(&folder);
    let (parameters, metadata) = Parameters::from_safetensors(&std::fs::read(weights)?)?;
    let info = NetworkInfo::from_metadata(&metadata)?;
    let encoding = info.encoding();
    let goals = [(12.0, 1.0, 0.2), (30.0, -4.0, 0.0), (50.0, 6.0, -0.3)];
    let goals = goals.map(|(x_m, y_m, yaw_rad)| Pose2::new(x_m, y_m, yaw_rad));
    let inputs = inputs(&info, &encoding, &goals)?;
    let (rows, cols) = encoding.input_size();
    let part = |from: usize, to: usize, channels: usize, shrink: usize| {
        let images = inputs.chunks_exact(encoding.input_len());
        let values: Vec<f32> = images.flat_map(|input| input[from..to].to_vec()).collect();
        let shape = (goals.len(), rows / shrink, cols / shrink, channels);
        Tensor::from_vec(values, shape, &Device::Cpu)?.permute((0, 3, 1, 2))
    };
    let planes = part(0, encoding.planes_len(), INPUT_PLANES, 1)?;
    write(folder, "planes", &planes)?;
    let features = if info.architecture == Architecture::EnetShared {
        let pixels = rows / SIDE_MULTIPLE * (cols / SIDE_MULTIPLE);
        let channels = encoding.features_len() / pixels;
        let (from, to) = (encoding.planes_len(), encoding.input_len());
        let features = part(from, to, channels, SIDE_MULTIPLE)?;
        write(folder, "features", &features)?;
        Some(features)
    } else {
        None
    };
    let network = Differentiable::new(parameters, (rows, cols))?;
    let logits = network.forward(&planes, features.as_ref())?;
    write(folder, "logits", &logits)
}

fn inputs(
    info: &NetworkInfo,
    encoding: &Encoding,
    goals: &[Pose2],
) -> Result<Vec<f32>, Box<dyn Error>> {
    let mut obstacles = Plane::empty(info.spec.rows, info.spec.cols);
    for index in 0..300_u32 {
        let row = index * 7919 % info.spec.rows;
        let col = index * 104_729 % info.spec.cols;
        obstacles.set(Cell::new(row.cast_signed(), col.cast_signed()));
    }
    let mut reference = Plane::empty(info.spec.rows, info.spec.cols);
    let ahead = [Pose2::default(), Pose2::new(55.0, 2.0, 0.0)];
    reference.draw_line(&info.spec, &ahead, info.reference_dilation_m);
    let surroundings = Surroundings {
        obstacles: &obstacles,
        reference: &reference,
        speed_m_per_s: 1.4,
    };
    let mut inputs = vec![0.0; goals.len() * encoding.input_len()];
    let images = inputs.chunks_exact_mut(encoding.input_len());
    for (goal, input) in goals.iter().zip(images) {
        encoding.encode(&surroundings, goal, input)?;
    }
    Ok(inputs)
}

fn write(folder: &Path, name: &str, tensor: &Tensor) -> Result<(), Box<dyn Error>> {
    let flat: Vec<f32> = tensor.flatten_all()?.to_vec1()?;
    let bytes: Vec<u8> = flat.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(folder.join(name), bytes)?;
    let shape: Vec<String> = tensor.dims().iter().map(ToString::to_string).collect();
    let shape = format!("{}\n", shape.join(" "));
    Ok(std::fs::write(folder.join(format!("{name}.shape")), shape)?)
}
