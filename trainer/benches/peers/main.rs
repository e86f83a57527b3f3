//! Times the engine beside ONNX Runtime, `PyTorch` and plain candle: the same network, the same
//! weights, in turns, in one run.
//!
//! `cargo bench --workspace --bench peers` (installs the runtimes into `.venv-peers` first)

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program that prints a table"
)]

use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use candle_core::{DType, Device, Tensor};
use swath_bridge::Pose2;
use swath_planner::Plane;
use swath_planner::network::{
    Architecture, Dropout, INPUT_PLANES, InputSize, Network, NetworkInfo, Parameters, Reference,
    Surroundings, Training, to_onnx,
};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Measurements of each kind; the first is thrown away.
const ROUNDS: usize = 8;
const SIZES: [InputSize; 2] = [InputSize::Full, InputSize::Half];
/// Asks this program to report the memory of a training step instead.
const MEMORY: &str = "--memory-of-a-step";

fn main() -> Result<()> {
    if std::env::args().any(|argument| argument == MEMORY) {
        return memory_of_a_step();
    }
    let folder = tempfile::tempdir()?;
    let mut peers = Peers::start()?;
    println!(
        "milliseconds, medians of {} rounds; ratios are ours to theirs",
        ROUNDS - 1
    );
    println!("\nforward, enet");
    println!("size  batch  threads |    ours  onnxruntime  ratio    pytorch  ratio    candle");
    let mut fifty_full = f64::NAN;
    for size in SIZES {
        let model = Model::new(Architecture::Enet, size, folder.path())?;
        for threads in [1, 2] {
            for batch in [1, 10, 50] {
                let row = forward(&model, &mut peers, (batch, threads))?;
                if (size, batch, threads) == (InputSize::Full, 50, 2) {
                    fifty_full = row;
                }
            }
        }
    }
    println!("\nforward and backward, enet, two threads");
    println!("size  batch |    ours    pytorch  ratio");
    for size in SIZES {
        let model = Model::new(Architecture::Enet, size, folder.path())?;
        for batch in [8, 16] {
            training(&model, &mut peers, batch)?;
        }
    }
    println!(
        "\nfifty targets on one map, two threads, beside fifty passes of full-size enet in ONNX Runtime"
    );
    for size in SIZES {
        let model = Model::new(Architecture::EnetShared, size, folder.path())?;
        let ours = median((0..ROUNDS).map(|_| model.predict(50)).collect());
        println!(
            "enet-shared {:4}: {ours:7.1} ms, 1/{:.1}",
            size.name(),
            fifty_full / ours
        );
    }
    let step = Command::new(std::env::current_exe()?)
        .arg(MEMORY)
        .output()?;
    print!("\n{}", String::from_utf8_lossy(&step.stdout));
    Ok(())
}

struct Model {
    info: NetworkInfo,
    parameters: Parameters,
    network: Network,
    onnx: PathBuf,
}

impl Model {
    fn new(architecture: Architecture, size: InputSize, folder: &Path) -> Result<Self> {
        let info = NetworkInfo {
            architecture,
            size,
            ..NetworkInfo::default()
        };
        let parameters = Parameters::initial(architecture, 1);
        let onnx = folder.join(format!("{}-{}.onnx", architecture.name(), size.name()));
        std::fs::write(&onnx, to_onnx(&info, &parameters))?;
        Ok(Self {
            network: Network::new(info.clone(), &parameters),
            info,
            parameters,
            onnx,
        })
    }

    /// Milliseconds of predictions from planes to regions, which is more than the others do.
    fn predict(&self, count: usize) -> f64 {
        let empty = || Plane::empty(self.info.spec.rows, self.info.spec.cols);
        let (mut obstacles, mut reference) = (empty(), empty());
        let line = |plane: &mut Plane, (from, to): ((f64, f64), (f64, f64)), radius_m: f64| {
            let ends = [Pose2::new(from.0, from.1, 0.0), Pose2::new(to.0, to.1, 0.0)];
            plane.draw_line(&self.info.spec, &ends, radius_m);
        };
        // A road between two walls, with two cars on it.
        for wall_y in [-6.0, 7.0] {
            line(&mut obstacles, ((-15.0, wall_y), (58.0, wall_y)), 0.2);
        }
        for (car_x, car_y) in [(15.0, 1.0), (28.0, -2.0)] {
            line(&mut obstacles, ((car_x, car_y), (car_x + 4.0, car_y)), 0.9);
        }
        line(&mut reference, ((-15.0, 0.0), (58.0, 0.0)), 1.0);
        let surroundings = Surroundings {
            obstacles: &obstacles,
            reference: &reference,
            speed_m_per_s: 1.4,
        };
        let goal = |index: usize| Pose2::new(10.0 + index as f64 * 0.9, 2.0, 0.1);
        let goals: Vec<Pose2> = (0..count).map(goal).collect();
        millis(|| {
            let regions = self.network.predict(&surroundings, &goals);
            assert!(regions.is_ok_and(|regions| regions.len() == count));
        })
    }

    fn request(&self, runtime: &str, (batch, threads): (usize, usize), training: bool) -> String {
        let (rows, cols) = self.info.encoding().input_size();
        serde_json::json!({
            "runtime": runtime,
            "path": self.onnx,
            "shape": [batch, INPUT_PLANES, rows, cols],
            "threads": threads,
            "training": training,
        })
        .to_string()
    }
}

/// A row of the table; ONNX Runtime's time.
fn forward(model: &Model, peers: &mut Peers, (batch, threads): (usize, usize)) -> Result<f64> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    let (mut ours, mut runtime, mut torch) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        ours.push(pool.install(|| model.predict(batch)));
        runtime.push(peers.ask(&model.request("onnxruntime", (batch, threads), false))?);
        torch.push(peers.ask(&model.request("pytorch", (batch, threads), false))?);
    }
    let candle = if threads == 2 {
        format!("{:9.1}", candle(model, batch)?)
    } else {
        "        -".to_owned()
    };
    let (ours, runtime, torch) = (median(ours), median(runtime), median(torch));
    println!(
        "{:5} {batch:5}  {threads:7} | {ours:7.2} {runtime:12.2} {:6.2} {torch:10.2} {:6.2} {candle}",
        model.info.size.name(),
        ours / runtime,
        ours / torch,
    );
    Ok(runtime)
}

/// Milliseconds of one pass of the plain model.
fn candle(model: &Model, batch: usize) -> Result<f64> {
    let (rows, cols) = model.info.encoding().input_size();
    let reference = Reference::new(&model.parameters, &Device::Cpu, DType::F32)?;
    let input = Tensor::ones((batch, INPUT_PLANES, rows, cols), DType::F32, &Device::Cpu)?;
    let mut result = Ok(());
    let elapsed = millis(|| result = reference.forward(&input, None, false).map(drop));
    result?;
    Ok(elapsed)
}

fn training(model: &Model, peers: &mut Peers, batch: usize) -> Result<()> {
    let size = model.info.encoding().input_size();
    let mut training = Training::new(Architecture::Enet, size).ok_or("the size does not fit")?;
    let (mut ours, mut torch) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        ours.push(millis(|| step(&mut training, &model.parameters, batch)));
        torch.push(peers.ask(&model.request("pytorch", (batch, 2), true))?);
    }
    let (ours, torch) = (median(ours), median(torch));
    println!(
        "{:5} {batch:5} | {ours:7.1} {torch:10.1} {:6.2}",
        model.info.size.name(),
        ours / torch
    );
    Ok(())
}

fn step(training: &mut Training, parameters: &Parameters, batch: usize) {
    let input = vec![0.5; batch * training.input_len()];
    let slope = vec![1e-6; batch * training.output_len()];
    let mut gradient = vec![0.0; parameters.values().len()];
    let dropout = Some(Dropout { seed: 1, pass: 1 });
    training.forward(parameters, &input, dropout);
    training.backward(parameters, (&slope, &[]), &mut gradient);
}

fn memory_of_a_step() -> Result<()> {
    let info = NetworkInfo {
        size: InputSize::Full,
        ..NetworkInfo::default()
    };
    let parameters = Parameters::initial(Architecture::Enet, 1);
    let size = info.encoding().input_size();
    let mut training = Training::new(Architecture::Enet, size).ok_or("the size does not fit")?;
    for _ in 0..2 {
        step(&mut training, &parameters, 16);
    }
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find(|line| line.starts_with("VmHWM"));
    println!(
        "peak memory of training steps of 16 at full size: {}",
        peak.unwrap_or("unknown")
    );
    Ok(())
}

fn millis(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64() * 1e3
}

/// The median of all but the first.
fn median(mut values: Vec<f64>) -> f64 {
    values.remove(0);
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The process that runs the others.
struct Peers {
    child: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Peers {
    fn start() -> Result<Self> {
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers");
        let python = environment(&here)?;
        let mut child = Command::new(python)
            .arg(here.join("peers.py"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let requests = child.stdin.take().ok_or("no standard input")?;
        let answers = BufReader::new(child.stdout.take().ok_or("no standard output")?);
        Ok(Self {
            child,
            requests,
            answers,
        })
    }

    /// Milliseconds that a request took.
    fn ask(&mut self, request: &str) -> Result<f64> {
        writeln!(self.requests, "{request}")?;
        let mut line = String::new();
        self.answers.read_line(&mut line)?;
        Ok(line.trim().parse::<f64>()? * 1e3)
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The interpreter of a virtual environment with the runtimes, made if need be.
fn environment(here: &Path) -> Result<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.venv-peers");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| -> Result<()> {
        let status = Command::new(program).args(arguments).status()?;
        if status.success() {
            Ok(())
        } else {
            Err(format!("{} {arguments:?} failed", program.display()).into())
        }
    };
    if !python.exists() {
        eprintln!("installing PyTorch and ONNX Runtime, once");
        run(
            Path::new("python3"),
            &["-m", "venv", &folder.display().to_string()],
        )?;
    }
    let requirements = here.join("requirements.txt").display().to_string();
    run(
        &python,
        &[
            "-m",
            "pip",
            "install",
            "--quiet",
            "--requirement",
            &requirements,
        ],
    )?;
    Ok(python)
}
