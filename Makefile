# Thin targets over cargo and the binary. CI, the README and people run the same ones.
#
#   make build      the program, target/release/lightkiln
#   make test       all tests
#   make test-view  `lightkiln view` and the report's page in a headless browser
#   make browser-deps  what the tests of the next line need: Chromium and Mesa's software Vulkan, by apt-get
#   make test-gpu   the WGSL on Vulkan against the CPU decoder    make test-gpu-web  the GLSL in headless Chromium
#   make oidn-library  Open Image Denoise, by pip into target/oidn    make test-oidn  its tests; LIGHTKILN_OIDN names another
#   make lint       clippy, warnings denied        make fmt   rustfmt
#   make bench      one bench per stage            make scenes  the big scenes, into data/big
#   make bake       bake every scene of data/ into out/; editing one scene rebuilds one
#   make bake-profiles  two of them in every profile, into out/profiles/
#   make report     print the reports of out/      make validate  validator and schemas over out/
#   make validate-scenes SCENES_DIR=...             the same over scenes of your own, and glTF-Transform
#   make test-scenes SCENES_DIR=...                 opens every one of them in three.js, Babylon.js and `view`
#   make viewer     npm ci of viewer/                make test-viewer  its tests, in headless Chromium
#   make sheets     the picture sheets of docs/       make figures  the charts of docs/
#   make pictures   those of the README and of docs/VIEW.md
#   make faults     the pictures of docs/FAULTS.md
#   make frame-times, make instructions              what light costs on a GPU
#   make side-by-side   pictures of the CPU, three.js and Babylon.js compared
#   make peers      irradiance against another path tracer, which PEERS_PYTHON has: see tests/peers

CARGO ?= cargo
LIGHTKILN = target/release/lightkiln
PROPS = target/release/lightkiln-props
BAKE_FLAGS ?= --quality draft
FIT = $(LIGHTKILN) fit --quiet --samples 250000 --size 400
SEAT_VIEW = --ao-distance inf --rays 128 --zoom 3.5 --target=0,0.35,0.05

# What tests are built with, all of them alike: no library is built twice. It needs cargo alone.
FEATURES = lightkiln-cli/oidn

SCENES = $(wildcard data/*.glb)
BAKED = $(SCENES:data/%.glb=out/%.baked.glb)

# Scenes that are baked in every profile.
PROFILES = eta stock texcoord lightmap
PROFILED = contact instances
IN_PROFILES = $(foreach s,$(PROFILED),$(PROFILES:%=out/profiles/$(s).%.glb))

# Where validate-scenes and others find scenes.
SCENES_DIR ?= ../shared/scenes
BAKED_SCENES = $(patsubst $(SCENES_DIR)/%,out/scenes/%,$(wildcard $(SCENES_DIR)/*.glb))

.PHONY: build test test-xatlas test-oidn oidn-library lint fmt fmt-check bench scenes bake report sheets faults figures clean
.PHONY: bake-profiles viewer test-viewer test-view test-scenes test-gpu test-gpu-web browser-deps
.PHONY: pictures frame-times instructions side-by-side test-build validator validate validate-scenes peers
.DELETE_ON_ERROR:

build:
	$(CARGO) build --release --locked --bins

test:
	$(CARGO) test --release --locked --workspace --features $(FEATURES)

# The shaders against their CPU twin: the WGSL on Vulkan, the GLSL in a browser. Mesa's llvmpipe filters textures of 8 bits
# in 8 bits unless it is told not to.
test-gpu:
	GALLIVM_PERF=no_aos_sampling $(CARGO) test --release --locked --workspace --features $(FEATURES),lightkiln-gpu/vulkan \
	  --test vulkan -- --nocapture

test-gpu-web: viewer
	$(CARGO) build --release --locked --workspace --features $(FEATURES) --example gpu_page
	@mkdir -p out
	target/release/examples/gpu_page > out/gpu_check.html
	node --test --test-reporter=spec tests/gpu/web.test.mjs

# What tests with a browser or a Vulkan driver need, on Debian and its kin.
browser-deps:
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium mesa-vulkan-drivers \
	  </dev/null >/dev/null

# Real scenes, opened in three.js, Babylon.js and `lightkiln view`.
test-scenes: $(BAKED_SCENES) build viewer
ifeq ($(BAKED_SCENES),)
	@echo "no .glb in SCENES_DIR, which is $(SCENES_DIR): there is nothing to open"; exit 1
else
	LIGHTKILN_FILES=$(CURDIR)/out/scenes node --test --test-reporter=spec viewer/scenes/
endif

# What light costs to show: frame times beside a full lightmap, and instructions of the shaders. The tables of docs/COST.md.
# ANGLE is what the browser draws with: the GPU where there is one (default), swiftshader, gl-egl ...
ANGLE ?= default
COSTLY = $(filter $(addprefix %/,$(addsuffix .glb,toy_car sheen_chair sunglasses glass_vase_flowers lamborghini_huracan \
  flight_helmet dream_apartment)),$(BAKED_SCENES)) out/big/car_100k.baked.glb
LIGHTMAPS = $(patsubst out/%,out/lightmaps/%,$(COSTLY))

define bake-lightmap
@mkdir -p $(@D)
$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --profile lightmap --authored-occlusion replace --quiet || test $$? = 6
endef

out/lightmaps/scenes/%.glb: $(SCENES_DIR)/%.glb | build
	$(bake-lightmap)

out/lightmaps/big/%.baked.glb: data/big/%.glb | build
	$(bake-lightmap)

frame-times: $(COSTLY) $(LIGHTMAPS) viewer
	node viewer/scenes/frame-times.mjs $(foreach f,$(COSTLY),$f=$(f:out/%=out/lightmaps/%)) --angle $(ANGLE)

data/big/car_100k.glb: | build
	@mkdir -p $(@D)
	$(PROPS) car --size 100000 -o $@

# A Python with the package vulkan; on Debian, glslang-tools and mesa-vulkan-drivers.
COST_PYTHON ?= python3
instructions: viewer
	node viewer/scenes/programs.mjs out/programs
	$(COST_PYTHON) tests/gpu/instructions.py --programs out/programs navi21 polaris10

# The light of real scenes on the CPU, in three.js and in Babylon.js, and of the profile stock without a plugin: the table and the picture of docs/VIEWERS.md.
# FLIP_PYTHON names a Python with the packages flip-evaluator and numpy.
BESIDE = $(filter %/lamborghini_huracan.glb %/flight_helmet.glb %/toy_car.glb %/sheen_chair.glb,$(BAKED_SCENES)) \
  out/cornell_light.baked.glb

comma = ,
STOCK = $(patsubst out/scenes/%,out/stock/%,$(filter out/scenes/%,$(BESIDE)))

out/stock/%.glb: $(SCENES_DIR)/%.glb | build
	@mkdir -p $(@D)
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --profile stock --authored-occlusion replace --quiet || test $$? = 6

side-by-side: $(BESIDE) $(STOCK) build viewer
	node viewer/scenes/side-by-side.mjs out/side_by_side \
	  $(foreach f,$(BESIDE),$(basename $(basename $(notdir $f)))=$f$(if $(filter out/scenes/%,$f),$(comma)$(f:out/scenes/%=out/stock/%)))
	cp out/side_by_side/contact.png docs/figures/side_by_side.png

# Builds what `test` runs, and the programs. Examples ask for the features that tests have: no library is built twice.
test-build:
	$(CARGO) test --release --locked --workspace --features $(FEATURES) --no-run
	$(CARGO) build --release --locked --workspace --features $(FEATURES) --bins --examples

# The optional packers of chart: they need libclang and a C++ compiler. cli and encode are named so that libraries
# have the features that they have in `test` and are not built twice; encode's own tests run along.
test-xatlas:
	$(CARGO) test --release --locked -p lightkiln-chart -p lightkiln-encode -p lightkiln-cli --lib --test charts \
	  --features $(FEATURES),lightkiln-chart/xatlas,lightkiln-chart/uvunwrap

# The tests that need Open Image Denoise: they say so where it is missing, and pass. All others around it are in `test`.
OIDN_VERSION = 2.5.1
OIDN = $(CURDIR)/target/oidn/pyoidn/oidn/lib/libOpenImageDenoise.so.2
LIGHTKILN_OIDN ?= $(wildcard $(OIDN))

test-oidn:
	LIGHTKILN_OIDN="$(LIGHTKILN_OIDN)" $(CARGO) test --release --locked --workspace --features $(FEATURES) \
	  --lib --test honesty --test denoisers -- --nocapture oidn_errors oidn_gives oidn_filters filtered_by_oidn

# The library as a Python package brings it, for Linux: 90 MB.
oidn-library: $(OIDN)

$(OIDN):
	@mkdir -p target/oidn
	timeout 120 python3 -m pip download --quiet --timeout 20 --retries 1 --no-deps --only-binary :all: \
	  --dest target/oidn pyoidn==$(OIDN_VERSION).0
	cd target/oidn && python3 -m zipfile -e pyoidn-$(OIDN_VERSION).0-*.whl . && rm pyoidn-*.whl

lint:
	$(CARGO) clippy --release --locked --workspace --all-targets --features $(FEATURES) -- -D warnings
	$(CARGO) clippy --release --locked --workspace --bins --lib -- -D warnings

# The viewer and the report's page in a browser: node, npm, and a Chromium (CHROMIUM names one).
test-view: build viewer
	node --test crates/page/browser/

fmt:
	$(CARGO) fmt --all

fmt-check:
	$(CARGO) fmt --all -- --check

bench:
	$(CARGO) bench --locked --workspace

$(LIGHTKILN) $(PROPS): build

# Name and size of each big scene stand in data/recipes.txt.
scenes: build
	mkdir -p data/big
	while read -r file scene size; do \
	  case "$$file" in ''|'#'*) continue;; esac; \
	  test -s "data/big/$$file" || $(PROPS) "$$scene" --size "$$size" -o "data/big/$$file" || exit 1; \
	done < data/recipes.txt

bake: $(BAKED)

out/%.baked.glb: data/%.glb | build
	@mkdir -p $(@D)
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --report out/$*.json --depfile out/$*.d

-include $(wildcard out/*.d)

bake-profiles: $(IN_PROFILES)

define in_profile
out/profiles/%.$(1).glb: data/%.glb | build
	@mkdir -p out/profiles
	$$(LIGHTKILN) bake $$< -o $$@ $$(BAKE_FLAGS) --profile $(1)

endef
$(foreach p,$(PROFILES),$(eval $(call in_profile,$(p))))

report: bake
	@for f in $(BAKED); do echo "== $$f"; $(LIGHTKILN) inspect $$f; done

validator:
	npm ci --prefix tests/validator --no-audit --no-fund --loglevel=error

validate: bake bake-profiles validator
	node tests/validator/validate.mjs $(SCENES) -- $(BAKED)
	node tests/validator/validate.mjs $(foreach s,$(PROFILED),$(PROFILES:%=data/$(s).glb)) -- $(IN_PROFILES)
	node tests/validator/schema.mjs $(BAKED:.baked.glb=.json) $(BAKED) $(IN_PROFILES)

viewer:
	npm ci --prefix viewer --no-audit --no-fund --loglevel=error

# The packages of viewer/, in headless Chromium, on what `bake` makes and on files of other signals.
test-viewer: bake bake-profiles viewer out/contact_signals.baked.glb out/cornell_box_light.baked.glb
	npm test --prefix viewer

out/contact_signals.baked.glb: data/contact.glb | build
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --signal ao+bent-normal+shadow:1,3,2,0.3

out/cornell_light.baked.glb: data/cornell.glb | build
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --signal lightmap

out/cornell_box_light.baked.glb: data/cornell_box.glb | build
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --signal lightmap

# A bound that a draft does not keep (6) is no fault of the file that was written.
out/scenes/%.glb: $(SCENES_DIR)/%.glb | build
	@mkdir -p out/scenes
	$(LIGHTKILN) bake $< -o $@ $(BAKE_FLAGS) --report out/scenes/$*.json --quiet || test $$? = 6

validate-scenes: $(BAKED_SCENES) validator
	node tests/validator/scenes.mjs "$(SCENES_DIR)" out/scenes
	node tests/validator/schema.mjs $(BAKED_SCENES:.glb=.json) $(BAKED_SCENES)

sheets: build
	docs/sheets.sh
	docs/light_sheets.sh

pictures: build viewer
	docs/pictures.sh "$(SCENES_DIR)"

faults: build
	docs/faults.sh

# Also prints the tables of docs/HALF_BOX.md.
figures: build
	$(CARGO) run --release --locked -p lightkiln-bake --example half_box_convergence -- data docs/half_box.svg
	mkdir -p out/figures docs/figures
	$(PROPS) seat --size 40000 -o out/figures/seat.glb
	$(PROPS) picture -o out/figures/picture.glb
	$(FIT) out/figures/seat.glb -o docs/figures/alpha.png $(SEAT_VIEW)
	$(FIT) out/figures/seat.glb -o docs/figures/edge_terms.png $(SEAT_VIEW) \
	  --regularizer edge-printed,edge --sweep alpha=0.1
	test ! -s "$(SCENES_DIR)/flight_helmet.glb" || $(FIT) "$(SCENES_DIR)/flight_helmet.glb" --rays 128 \
	  -o docs/figures/helmet.png --zoom 2.2 --method average,ours --regularizer edge-printed,edge \
	  --sweep alpha=0.1
	for n in 16 32 64; do \
	  $(PROPS) l_shape --size $$n -o out/figures/l_shape_$$n.glb && \
	  $(FIT) out/figures/l_shape_$$n.glb -o docs/figures/l_shape_$$n.png --signal=shadow:-0.5,2.2,-0.8,0.08 \
	    --method average,ours --sweep alpha=0.1 --rays 256 --view=-25,55 --zoom 1.6 --target 0.5,0.1,0.6 || exit 1; \
	done
	$(FIT) out/figures/picture.glb -o docs/figures/picture.png --signal base-color --method point,average,ours \
	  --sweep alpha=0 --view front --zoom 1.06

# A Python with the modules of tests/peers/requirements.txt. The table of docs/CYCLES.md; half an hour on two cores.
PEERS_PYTHON ?= python3
peers:
	@mkdir -p out/peers
	$(CARGO) run --release --locked -p lightkiln-bake --example irradiance_points -- \
	  data/cornell.glb 1000 8192 > out/peers/ours.json
	$(PEERS_PYTHON) tests/peers/cornell_cycles.py data/cornell.glb out/peers/ours.json \
	  --samples 4096 --runs 24 > out/peers/cycles.json
	$(PEERS_PYTHON) tests/peers/compare.py out/peers/ours.json out/peers/cycles.json

clean:
	rm -rf out
