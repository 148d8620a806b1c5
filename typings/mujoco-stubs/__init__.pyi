# Written by typings/make.py from mujoco's wheel.
import collections.abc
import typing

import numpy
import numpy.typing

_Got = typing.TypeVar("_Got")
_Given = typing.TypeVar("_Given")

class _Attribute(typing.Generic[_Got, _Given]):
    def __get__(self, instance: object, owner: type) -> _Got: ...
    def __set__(self, instance: object, value: _Given) -> None: ...

class _Enum:
    name: str
    value: int
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...
    def __or__(self, other: typing.SupportsInt) -> int: ...
    def __ror__(self, other: typing.SupportsInt) -> int: ...

class MjContact:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjContact: ...
    dist: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    mu: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    dim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    geom1: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    geom2: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    exclude: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    frame: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    solreffriction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    H: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    flex: _Attribute[numpy.typing.NDArray[numpy.int32], object]

class MjData:
    def __init__(self, arg0: MjModel) -> None: ...
    model: _Attribute[MjModel, typing.Never]
    def __copy__(self) -> MjData: ...
    signature: _Attribute[int, typing.Never]
    ncon: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nf: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nefc: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nisland: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    time: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    qpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qvel: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    act: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    history: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qacc_warmstart: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ctrl: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_applied: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qacc: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    userdata: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    sensordata: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    plugin: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ximat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xanchor: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xaxis: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    M: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_bias: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_actuator: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_inverse: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    contact: _Attribute[_MjContactList, typing.Never]
    efc_type: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    efc_frictionloss: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    map_efc2iefc: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    iefc_frictionloss: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    solver: _Attribute[_MjSolverStatList, typing.Never]
    warning: _Attribute[_MjWarningStatList, typing.Never]
    energy: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    @typing.overload
    def actuator(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataActuatorViews: ...
    @typing.overload
    def actuator(self, name: str = ...) -> _MjDataActuatorViews: ...
    @typing.overload
    def body(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataBodyViews: ...
    @typing.overload
    def body(self, name: str = ...) -> _MjDataBodyViews: ...
    @typing.overload
    def geom(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataGeomViews: ...
    @typing.overload
    def geom(self, name: str = ...) -> _MjDataGeomViews: ...
    @typing.overload
    def light(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataLightViews: ...
    @typing.overload
    def light(self, name: str = ...) -> _MjDataLightViews: ...
    @typing.overload
    def sensor(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataSensorViews: ...
    @typing.overload
    def sensor(self, name: str = ...) -> _MjDataSensorViews: ...
    @typing.overload
    def site(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataSiteViews: ...
    @typing.overload
    def site(self, name: str = ...) -> _MjDataSiteViews: ...
    @typing.overload
    def tendon(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataTendonViews: ...
    @typing.overload
    def tendon(self, name: str = ...) -> _MjDataTendonViews: ...
    @typing.overload
    def camera(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataCameraViews: ...
    @typing.overload
    def camera(self, name: str = ...) -> _MjDataCameraViews: ...
    @typing.overload
    def joint(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataJointViews: ...
    @typing.overload
    def joint(self, name: str = ...) -> _MjDataJointViews: ...
    @typing.overload
    def ten(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjDataTendonViews: ...
    @typing.overload
    def ten(self, name: str = ...) -> _MjDataTendonViews: ...
    def bind(*args: typing.Any, **kwargs: typing.Any) -> typing.Any: ...

class MjDoubleVec:
    def __init__(self, arg0: typing.SupportsFloat | typing.SupportsIndex, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> float: ...
    def __setitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> collections.abc.Iterator[float]: ...

class MjFloatVec:
    def __init__(self, arg0: typing.SupportsFloat | typing.SupportsIndex, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> float: ...
    def __setitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> collections.abc.Iterator[float]: ...

class MjIntVec:
    def __init__(self, arg0: typing.SupportsInt | typing.SupportsIndex, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> int: ...
    def __setitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> collections.abc.Iterator[int]: ...

class MjModel:
    @staticmethod
    def from_xml_string(xml: str, assets: collections.abc.Mapping[str, bytes] | None = ..., vfs: typing.Any | None = ...) -> MjModel: ...
    @staticmethod
    def from_xml_path(filename: str, assets: collections.abc.Mapping[str, bytes] | None = ..., vfs: typing.Any | None = ...) -> MjModel: ...
    def __copy__(self) -> MjModel: ...
    opt: _Attribute[MjOption, MjOption]
    vis: _Attribute[MjVisual, MjVisual]
    stat: _Attribute[typing.Any, typing.Any]
    nq: _Attribute[int, typing.Never]
    nv: _Attribute[int, typing.Never]
    nu: _Attribute[int, typing.Never]
    na: _Attribute[int, typing.Never]
    nbody: _Attribute[int, typing.Never]
    njnt: _Attribute[int, typing.Never]
    nM: _Attribute[int, typing.Never]
    ngeom: _Attribute[int, typing.Never]
    nsite: _Attribute[int, typing.Never]
    nflex: _Attribute[int, typing.Never]
    nmeshvert: _Attribute[int, typing.Never]
    neq: _Attribute[int, typing.Never]
    ntendon: _Attribute[int, typing.Never]
    nkey: _Attribute[int, typing.Never]
    njmax: _Attribute[int, typing.Never]
    nconmax: _Attribute[int, typing.Never]
    nuserdata: _Attribute[int, typing.Never]
    nsensordata: _Attribute[int, typing.Never]
    nhistory: _Attribute[int, typing.Never]
    qpos0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qpos_spring: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_parentid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_rootid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_weldid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_jntnum: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_jntadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_simple: _Attribute[numpy.typing.NDArray[numpy.uint8], object]
    body_pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_ipos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_iquat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_mass: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_subtreemass: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_inertia: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_invweight0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_gravcomp: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    body_contype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    body_conaffinity: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    bvh_aabb: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    jnt_type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    jnt_qposadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    jnt_dofadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    jnt_bodyid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    jnt_limited: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    jnt_pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    jnt_axis: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    jnt_stiffness: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    jnt_stiffnesspoly: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    jnt_range: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_treeid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    dof_simplenum: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    dof_solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_solimp: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_frictionloss: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_armature: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_damping: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_dampingpoly: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_invweight0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_M0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dof_length: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_contype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_conaffinity: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_bodyid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_dataid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_group: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_priority: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom_solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_size: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_aabb: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_rbound: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_friction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    geom_rgba: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    site_bodyid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    cam_poscom0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    cam_resolution: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    light_dir: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    light_poscom0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    mesh_vertadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    mesh_vertnum: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    mesh_faceadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    mesh_facenum: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    mesh_vert: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    mesh_face: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    pair_geom1: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    pair_geom2: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    pair_solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    pair_friction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    eq_type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    eq_obj1id: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    eq_obj2id: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    eq_objtype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    eq_active0: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    tendon_adr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    tendon_num: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    tendon_limited: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    tendon_stiffness: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    tendon_damping: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    tendon_armature: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    tendon_frictionloss: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    wrap_type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    wrap_objid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    wrap_prm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_trnid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    actuator_dynprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_gainprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_biasprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_history: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    actuator_delay: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_forcerange: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    actuator_acc0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    sensor_noise: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    plugin: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    names: _Attribute[bytes, typing.Never]
    paths: _Attribute[bytes, typing.Never]
    signature: _Attribute[int, typing.Never]
    @typing.overload
    def actuator(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelActuatorViews: ...
    @typing.overload
    def actuator(self, name: str = ...) -> _MjModelActuatorViews: ...
    @typing.overload
    def body(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelBodyViews: ...
    @typing.overload
    def body(self, name: str = ...) -> _MjModelBodyViews: ...
    @typing.overload
    def exclude(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelExcludeViews: ...
    @typing.overload
    def exclude(self, name: str = ...) -> _MjModelExcludeViews: ...
    @typing.overload
    def geom(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelGeomViews: ...
    @typing.overload
    def geom(self, name: str = ...) -> _MjModelGeomViews: ...
    @typing.overload
    def light(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelLightViews: ...
    @typing.overload
    def light(self, name: str = ...) -> _MjModelLightViews: ...
    @typing.overload
    def mesh(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelMeshViews: ...
    @typing.overload
    def mesh(self, name: str = ...) -> _MjModelMeshViews: ...
    @typing.overload
    def pair(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelPairViews: ...
    @typing.overload
    def pair(self, name: str = ...) -> _MjModelPairViews: ...
    @typing.overload
    def sensor(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelSensorViews: ...
    @typing.overload
    def sensor(self, name: str = ...) -> _MjModelSensorViews: ...
    @typing.overload
    def site(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelSiteViews: ...
    @typing.overload
    def site(self, name: str = ...) -> _MjModelSiteViews: ...
    @typing.overload
    def tendon(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelTendonViews: ...
    @typing.overload
    def tendon(self, name: str = ...) -> _MjModelTendonViews: ...
    @typing.overload
    def tuple(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelTupleViews: ...
    @typing.overload
    def tuple(self, name: str = ...) -> _MjModelTupleViews: ...
    @typing.overload
    def key(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelKeyframeViews: ...
    @typing.overload
    def key(self, name: str = ...) -> _MjModelKeyframeViews: ...
    @typing.overload
    def camera(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelCameraViews: ...
    @typing.overload
    def camera(self, name: str = ...) -> _MjModelCameraViews: ...
    @typing.overload
    def equality(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelEqualityViews: ...
    @typing.overload
    def equality(self, name: str = ...) -> _MjModelEqualityViews: ...
    @typing.overload
    def joint(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelJointViews: ...
    @typing.overload
    def joint(self, name: str = ...) -> _MjModelJointViews: ...
    @typing.overload
    def material(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> _MjModelMaterialViews: ...
    @typing.overload
    def material(self, name: str = ...) -> _MjModelMaterialViews: ...
    def bind(*args: typing.Any, **kwargs: typing.Any) -> typing.Any: ...

class MjOption:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjOption: ...
    timestep: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    impratio: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    tolerance: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    gravity: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    density: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    viscosity: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    integrator: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    cone: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    jacobian: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    solver: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    iterations: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    disableflags: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    enableflags: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]

class MjSolverStat:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjSolverStat: ...
    gradient: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]

class MjSpec:
    def __init__(self) -> None: ...
    parent: _Attribute[MjSpec, typing.Never]
    @staticmethod
    def from_file(filename: str, include: collections.abc.Mapping[str, bytes] | None = ..., assets: dict | None = ..., vfs: MjVfs | None = ...) -> MjSpec: ...
    @staticmethod
    def from_string(xml: str, include: collections.abc.Mapping[str, bytes] | None = ..., assets: dict | None = ..., vfs: MjVfs | None = ...) -> MjSpec: ...
    def copy(self) -> MjSpec: ...
    worldbody: _Attribute[MjsBody, typing.Never]
    def compile(self, vfs: MjVfs | None = ...) -> MjModel: ...
    assets: _Attribute[dict, dict]
    def to_xml(self) -> str: ...
    def encode(self, filename: str, model: object | None = ..., content_type: str | None = ...) -> int: ...
    @typing.overload
    def delete(self, arg0: MjsDefault) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsBody) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsFrame) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsGeom) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsJoint) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsSite) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsCamera) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsLight) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsMaterial) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsMesh) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsPair) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsEquality) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsActuator) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsTendon) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsSensor) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsFlex) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsHField) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsSkin) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsTexture) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsKey) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsText) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsNumeric) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsExclude) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsTuple) -> None: ...
    @typing.overload
    def delete(self, arg0: MjsPlugin) -> None: ...
    default: _Attribute[MjsDefault, typing.Never]
    def attach(self, child: MjSpec, prefix: str | None = ..., suffix: str | None = ..., site: object | None = ..., frame: object | None = ...) -> MjsFrame: ...
    meshdir: _Attribute[str, str]
    texturedir: _Attribute[str, str]
    modelname: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, MjsCompiler]
    option: _Attribute[_SpecMjOption, _SpecMjOption]
    visual: _Attribute[_SpecMjVisual, _SpecMjVisual]
    stat: _Attribute[_SpecMjStatistic, _SpecMjStatistic]
    memory: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nuserdata: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nkey: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    njmax: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nconmax: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    comment: _Attribute[str, str]
    bodies: _Attribute[list, typing.Never]
    sites: _Attribute[list, typing.Never]
    geoms: _Attribute[list, typing.Never]
    joints: _Attribute[list, typing.Never]
    cameras: _Attribute[list, typing.Never]
    frames: _Attribute[list, typing.Never]
    lights: _Attribute[list, typing.Never]
    def add_mesh(self, default: MjsDefault | None = ..., name: str | None = ..., content_type: str | None = ..., file: str | None = ..., refpos: numpy.typing.ArrayLike | None = ..., refquat: numpy.typing.ArrayLike | None = ..., scale: numpy.typing.ArrayLike | None = ..., inertia: typing.SupportsInt | typing.SupportsIndex | None = ..., smoothnormal: typing.SupportsInt | typing.SupportsIndex | None = ..., needsdf: typing.SupportsInt | typing.SupportsIndex | None = ..., maxhullvert: typing.SupportsInt | typing.SupportsIndex | None = ..., uservert: numpy.typing.ArrayLike | None = ..., usernormal: numpy.typing.ArrayLike | None = ..., usertexcoord: numpy.typing.ArrayLike | None = ..., userface: numpy.typing.ArrayLike | None = ..., userfacenormal: numpy.typing.ArrayLike | None = ..., userfacetexcoord: numpy.typing.ArrayLike | None = ..., usernode: numpy.typing.ArrayLike | None = ..., usertet: numpy.typing.ArrayLike | None = ..., plugin: MjsPlugin | None = ..., material: str | None = ..., octree_maxdepth: typing.SupportsInt | typing.SupportsIndex | None = ..., info: str | None = ...) -> MjsMesh: ...
    meshes: _Attribute[list, typing.Never]
    skins: _Attribute[list, typing.Never]
    hfields: _Attribute[list, typing.Never]
    textures: _Attribute[list, typing.Never]
    def add_material(self, default: MjsDefault | None = ..., name: str | None = ..., textures: collections.abc.Sequence[str] | None = ..., texuniform: typing.SupportsInt | typing.SupportsIndex | None = ..., texrepeat: numpy.typing.ArrayLike | None = ..., emission: typing.SupportsFloat | typing.SupportsIndex | None = ..., specular: typing.SupportsFloat | typing.SupportsIndex | None = ..., shininess: typing.SupportsFloat | typing.SupportsIndex | None = ..., reflectance: typing.SupportsFloat | typing.SupportsIndex | None = ..., metallic: typing.SupportsFloat | typing.SupportsIndex | None = ..., roughness: typing.SupportsFloat | typing.SupportsIndex | None = ..., rgba: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsMaterial: ...
    def add_pair(self, default: MjsDefault | None = ..., name: str | None = ..., geomname1: str | None = ..., geomname2: str | None = ..., condim: typing.SupportsInt | typing.SupportsIndex | None = ..., solref: numpy.typing.ArrayLike | None = ..., solreffriction: numpy.typing.ArrayLike | None = ..., solimp: numpy.typing.ArrayLike | None = ..., margin: typing.SupportsFloat | typing.SupportsIndex | None = ..., gap: typing.SupportsFloat | typing.SupportsIndex | None = ..., adhesion: typing.SupportsFloat | typing.SupportsIndex | None = ..., friction: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsPair: ...
    pairs: _Attribute[list, typing.Never]
    equalities: _Attribute[list, typing.Never]
    tendons: _Attribute[list, typing.Never]
    def add_actuator(self, default: MjsDefault | None = ..., name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., gaintype: typing.SupportsInt | typing.SupportsIndex | None = ..., gainprm: numpy.typing.ArrayLike | None = ..., biastype: typing.SupportsInt | typing.SupportsIndex | None = ..., biasprm: numpy.typing.ArrayLike | None = ..., dyntype: typing.SupportsInt | typing.SupportsIndex | None = ..., dynprm: numpy.typing.ArrayLike | None = ..., actdim: typing.SupportsInt | typing.SupportsIndex | None = ..., ctrlspec: typing.SupportsInt | typing.SupportsIndex | None = ..., velrange: numpy.typing.ArrayLike | None = ..., ffrange: numpy.typing.ArrayLike | None = ..., actearly: typing.SupportsInt | typing.SupportsIndex | None = ..., trntype: typing.SupportsInt | typing.SupportsIndex | None = ..., gear: numpy.typing.ArrayLike | None = ..., target: str | None = ..., refsite: str | None = ..., slidersite: str | None = ..., cranklength: typing.SupportsFloat | typing.SupportsIndex | None = ..., lengthrange: numpy.typing.ArrayLike | None = ..., inheritrange: typing.SupportsFloat | typing.SupportsIndex | None = ..., damping: object | None = ..., armature: typing.SupportsFloat | typing.SupportsIndex | None = ..., ctrllimited: typing.SupportsInt | typing.SupportsIndex | None = ..., ctrlrange: numpy.typing.ArrayLike | None = ..., forcelimited: typing.SupportsInt | typing.SupportsIndex | None = ..., forcerange: numpy.typing.ArrayLike | None = ..., actlimited: typing.SupportsInt | typing.SupportsIndex | None = ..., actrange: numpy.typing.ArrayLike | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., nsample: typing.SupportsInt | typing.SupportsIndex | None = ..., interp: typing.SupportsInt | typing.SupportsIndex | None = ..., delay: typing.SupportsFloat | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsActuator: ...
    actuators: _Attribute[list, typing.Never]
    def add_sensor(self, name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., objtype: typing.SupportsInt | typing.SupportsIndex | None = ..., objname: str | None = ..., reftype: typing.SupportsInt | typing.SupportsIndex | None = ..., refname: str | None = ..., intprm: numpy.typing.ArrayLike | None = ..., datatype: typing.SupportsInt | typing.SupportsIndex | None = ..., needstage: typing.SupportsInt | typing.SupportsIndex | None = ..., dim: typing.SupportsInt | typing.SupportsIndex | None = ..., cutoff: typing.SupportsFloat | typing.SupportsIndex | None = ..., noise: typing.SupportsFloat | typing.SupportsIndex | None = ..., nsample: typing.SupportsInt | typing.SupportsIndex | None = ..., interp: typing.SupportsInt | typing.SupportsIndex | None = ..., delay: typing.SupportsFloat | typing.SupportsIndex | None = ..., interval: numpy.typing.ArrayLike | None = ..., userdata: numpy.typing.ArrayLike | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsSensor: ...
    sensors: _Attribute[list, typing.Never]
    def add_text(self, name: str | None = ..., data: str | None = ..., info: str | None = ...) -> MjsText: ...
    texts: _Attribute[list, typing.Never]
    def add_key(self, name: str | None = ..., time: typing.SupportsFloat | typing.SupportsIndex | None = ..., qpos: numpy.typing.ArrayLike | None = ..., qvel: numpy.typing.ArrayLike | None = ..., act: numpy.typing.ArrayLike | None = ..., mpos: numpy.typing.ArrayLike | None = ..., mquat: numpy.typing.ArrayLike | None = ..., ctrl: numpy.typing.ArrayLike | None = ..., plastic: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsKey: ...
    keys: _Attribute[list, typing.Never]
    def body(self, arg0: str) -> MjsBody: ...
    def site(self, arg0: str) -> MjsSite: ...
    def geom(self, arg0: str) -> MjsGeom: ...
    def joint(self, arg0: str) -> MjsJoint: ...
    def camera(self, arg0: str) -> MjsCamera: ...
    def frame(self, arg0: str) -> MjsFrame: ...
    def light(self, arg0: str) -> MjsLight: ...
    def flex(self, arg0: str) -> MjsFlex: ...
    def mesh(self, arg0: str) -> MjsMesh: ...
    def material(self, arg0: str) -> MjsMaterial: ...
    def pair(self, arg0: str) -> MjsPair: ...
    def equality(self, arg0: str) -> MjsEquality: ...
    def tendon(self, arg0: str) -> MjsTendon: ...
    def actuator(self, arg0: str) -> MjsActuator: ...
    def sensor(self, arg0: str) -> MjsSensor: ...
    def text(self, arg0: str) -> MjsText: ...
    def tuple(self, arg0: str) -> MjsTuple: ...
    def key(self, arg0: str) -> MjsKey: ...
    def exclude(self, arg0: str) -> MjsExclude: ...
    def plugin(self, arg0: str) -> MjsPlugin: ...

class MjStringVec:
    def __init__(self, arg0: str, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> str: ...
    def __setitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex, arg1: str) -> None: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> collections.abc.Iterator[str]: ...

class MjVfs:
    def __init__(self) -> None: ...
    def close(self) -> None: ...
    def __enter__(self) -> MjVfs: ...
    def __exit__(self, arg0: object, arg1: object, arg2: object) -> None: ...
    def __setitem__(self, arg0: str, arg1: bytes) -> None: ...

class MjVisual:
    def __copy__(self) -> MjVisual: ...
    class Global:
        def __copy__(self) -> MjVisual.Global: ...
        fovy: _Attribute[float, typing.Any]
        azimuth: _Attribute[float, typing.Any]
        linewidth: _Attribute[float, typing.Any]
        realtime: _Attribute[float, typing.Any]
        offwidth: _Attribute[int, typing.Any]
        offheight: _Attribute[int, typing.Any]
    
    class Quality:
        def __copy__(self) -> MjVisual.Quality: ...
        offsamples: _Attribute[int, typing.Any]
    
    class Headlight:
        def __copy__(self) -> MjVisual.Headlight: ...
        ambient: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        diffuse: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        specular: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        active: _Attribute[int, typing.Any]
    
    class Map:
        def __copy__(self) -> MjVisual.Map: ...
        stiffness: _Attribute[float, typing.Any]
        force: _Attribute[float, typing.Any]
        torque: _Attribute[float, typing.Any]
        alpha: _Attribute[float, typing.Any]
        znear: _Attribute[float, typing.Any]
        zfar: _Attribute[float, typing.Any]
    
    class Scale:
        def __copy__(self) -> MjVisual.Scale: ...
        connect: _Attribute[float, typing.Any]
        com: _Attribute[float, typing.Any]
        camera: _Attribute[float, typing.Any]
        light: _Attribute[float, typing.Any]
        constraint: _Attribute[float, typing.Any]
    
    class Rgba:
        def __copy__(self) -> MjVisual.Rgba: ...
        force: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        inertia: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        joint: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        actuator: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        com: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        camera: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        light: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        connect: _Attribute[numpy.typing.NDArray[numpy.float32], object]
        constraint: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    
    global_: _Attribute[MjVisual.Global, MjVisual.Global]
    quality: _Attribute[MjVisual.Quality, MjVisual.Quality]
    headlight: _Attribute[MjVisual.Headlight, MjVisual.Headlight]
    map: _Attribute[MjVisual.Map, MjVisual.Map]
    scale: _Attribute[MjVisual.Scale, MjVisual.Scale]
    rgba: _Attribute[MjVisual.Rgba, MjVisual.Rgba]

class MjVisualHeadlight:
    ambient: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    diffuse: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    specular: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    active: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]

class MjVisualRgba:
    force: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    inertia: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    joint: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    actuator: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    com: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    camera: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    light: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    connect: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    constraint: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]

class MjWarningStat:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjWarningStat: ...
    number: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]

class MjrContext:
    @typing.overload
    def __init__(self) -> None: ...
    @typing.overload
    def __init__(self, arg0: MjModel, arg1: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def free(self) -> None: ...

class MjrRect:
    def __init__(self, left: typing.SupportsInt | typing.SupportsIndex, bottom: typing.SupportsInt | typing.SupportsIndex, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __copy__(self) -> MjrRect: ...
    left: _Attribute[int, typing.Any]
    bottom: _Attribute[int, typing.Any]
    width: _Attribute[int, typing.Any]
    height: _Attribute[int, typing.Any]

class MjsActuator:
    def set_to_motor(self) -> None: ...
    def set_to_dcmotor(self, motorconst: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(2)"], resistance: typing.SupportsFloat | typing.SupportsIndex, nominal: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(3)"] = ..., saturation: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(3)"] = ..., inductance: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(2)"] = ..., cogging: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(3)"] = ..., controller: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(6)"] = ..., thermal: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(6)"] = ..., lugre: typing.Annotated[numpy.typing.ArrayLike, "FixedSize(5)"] = ..., ctrlspec: typing.SupportsInt | typing.SupportsIndex = ...) -> None: ...
    type: _Attribute[mjtActuator, typing.SupportsInt | typing.SupportsIndex]
    gaintype: _Attribute[mjtGain, typing.SupportsInt | typing.SupportsIndex]
    gainprm: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    biastype: _Attribute[mjtBias, typing.SupportsInt | typing.SupportsIndex]
    biasprm: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    dyntype: _Attribute[mjtDyn, typing.SupportsInt | typing.SupportsIndex]
    dynprm: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    ctrlspec: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    actearly: _Attribute[bool, bool]
    trntype: _Attribute[mjtTrn, typing.SupportsInt | typing.SupportsIndex]
    gear: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    target: _Attribute[str, str]
    damping: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    armature: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    ctrllimited: _Attribute[mjtLimited, typing.SupportsInt | typing.SupportsIndex]
    ctrlrange: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    forcelimited: _Attribute[mjtLimited, typing.SupportsInt | typing.SupportsIndex]
    forcerange: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nsample: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    interp: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    delay: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    userdata: _Attribute[MjDoubleVec, object]
    plugin: _Attribute[MjsPlugin, MjsPlugin]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsBody:
    def add_freejoint(self, **kwargs) -> MjsJoint: ...
    @typing.overload
    def find_all(self, arg0: mjtObj) -> list: ...
    @typing.overload
    def find_all(self, arg0: str) -> list: ...
    bodies: _Attribute[list, typing.Never]
    cameras: _Attribute[list, typing.Never]
    lights: _Attribute[list, typing.Never]
    joints: _Attribute[list, typing.Never]
    geoms: _Attribute[list, typing.Never]
    sites: _Attribute[list, typing.Never]
    frames: _Attribute[list, typing.Never]
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    mass: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    ipos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    inertia: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    fullinertia: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    sleep: _Attribute[mjtSleepPolicy, typing.SupportsInt | typing.SupportsIndex]
    userdata: _Attribute[MjDoubleVec, object]
    explicitinertial: _Attribute[bool, bool]
    plugin: _Attribute[MjsPlugin, MjsPlugin]
    info: _Attribute[str, str]
    def add_body(self, default: MjsDefault | None = ..., name: str | None = ..., childclass: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., mass: typing.SupportsFloat | typing.SupportsIndex | None = ..., ipos: numpy.typing.ArrayLike | None = ..., iquat: numpy.typing.ArrayLike | None = ..., inertia: numpy.typing.ArrayLike | None = ..., iaxisangle: numpy.typing.ArrayLike | None = ..., ixyaxes: numpy.typing.ArrayLike | None = ..., izaxis: numpy.typing.ArrayLike | None = ..., ieuler: numpy.typing.ArrayLike | None = ..., fullinertia: numpy.typing.ArrayLike | None = ..., mocap: typing.SupportsInt | typing.SupportsIndex | None = ..., gravcomp: typing.SupportsFloat | typing.SupportsIndex | None = ..., sleep: typing.SupportsInt | typing.SupportsIndex | None = ..., simple: typing.SupportsInt | typing.SupportsIndex | None = ..., fuse: typing.SupportsInt | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., explicitinertial: typing.SupportsInt | typing.SupportsIndex | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsBody: ...
    def add_site(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., fromto: numpy.typing.ArrayLike | None = ..., size: object | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., material: str | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., rgba: numpy.typing.ArrayLike | None = ..., meshname: str | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsSite: ...
    def add_geom(self, default: MjsDefault | None = ..., name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., fromto: numpy.typing.ArrayLike | None = ..., size: object | None = ..., contype: typing.SupportsInt | typing.SupportsIndex | None = ..., conaffinity: typing.SupportsInt | typing.SupportsIndex | None = ..., condim: typing.SupportsInt | typing.SupportsIndex | None = ..., priority: typing.SupportsInt | typing.SupportsIndex | None = ..., friction: numpy.typing.ArrayLike | None = ..., solmix: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref: numpy.typing.ArrayLike | None = ..., solimp: numpy.typing.ArrayLike | None = ..., margin: typing.SupportsFloat | typing.SupportsIndex | None = ..., gap: typing.SupportsFloat | typing.SupportsIndex | None = ..., surfacevel: numpy.typing.ArrayLike | None = ..., adhesion: typing.SupportsFloat | typing.SupportsIndex | None = ..., mass: typing.SupportsFloat | typing.SupportsIndex | None = ..., density: typing.SupportsFloat | typing.SupportsIndex | None = ..., typeinertia: typing.SupportsInt | typing.SupportsIndex | None = ..., fluid_ellipsoid: typing.SupportsInt | typing.SupportsIndex | None = ..., fluid_coefs: numpy.typing.ArrayLike | None = ..., material: str | None = ..., rgba: numpy.typing.ArrayLike | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., castshadow: typing.SupportsInt | typing.SupportsIndex | None = ..., hfieldname: str | None = ..., meshname: str | None = ..., fitscale: typing.SupportsFloat | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsGeom: ...
    def add_joint(self, default: MjsDefault | None = ..., name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., pos: numpy.typing.ArrayLike | None = ..., axis: numpy.typing.ArrayLike | None = ..., ref: typing.SupportsFloat | typing.SupportsIndex | None = ..., align: typing.SupportsInt | typing.SupportsIndex | None = ..., stiffness: object | None = ..., springref: typing.SupportsFloat | typing.SupportsIndex | None = ..., springyield: typing.SupportsFloat | typing.SupportsIndex | None = ..., springdamper: numpy.typing.ArrayLike | None = ..., limited: typing.SupportsInt | typing.SupportsIndex | None = ..., range: numpy.typing.ArrayLike | None = ..., margin: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref_limit: numpy.typing.ArrayLike | None = ..., solimp_limit: numpy.typing.ArrayLike | None = ..., actfrclimited: typing.SupportsInt | typing.SupportsIndex | None = ..., actfrcrange: numpy.typing.ArrayLike | None = ..., armature: typing.SupportsFloat | typing.SupportsIndex | None = ..., damping: object | None = ..., frictionloss: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref_friction: numpy.typing.ArrayLike | None = ..., solimp_friction: numpy.typing.ArrayLike | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., actgravcomp: typing.SupportsInt | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsJoint: ...
    def add_camera(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., mode: typing.SupportsInt | typing.SupportsIndex | None = ..., targetbody: str | None = ..., proj: typing.SupportsInt | typing.SupportsIndex | None = ..., resolution: numpy.typing.ArrayLike | None = ..., output: typing.SupportsInt | typing.SupportsIndex | None = ..., fovy: typing.SupportsFloat | typing.SupportsIndex | None = ..., ipd: typing.SupportsFloat | typing.SupportsIndex | None = ..., intrinsic: numpy.typing.ArrayLike | None = ..., sensor_size: numpy.typing.ArrayLike | None = ..., focal_length: numpy.typing.ArrayLike | None = ..., focal_pixel: numpy.typing.ArrayLike | None = ..., principal_length: numpy.typing.ArrayLike | None = ..., principal_pixel: numpy.typing.ArrayLike | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsCamera: ...
    def add_light(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., dir: numpy.typing.ArrayLike | None = ..., mode: typing.SupportsInt | typing.SupportsIndex | None = ..., targetbody: str | None = ..., active: typing.SupportsInt | typing.SupportsIndex | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., texture: str | None = ..., castshadow: typing.SupportsInt | typing.SupportsIndex | None = ..., bulbradius: typing.SupportsFloat | typing.SupportsIndex | None = ..., intensity: typing.SupportsFloat | typing.SupportsIndex | None = ..., range: typing.SupportsFloat | typing.SupportsIndex | None = ..., attenuation: numpy.typing.ArrayLike | None = ..., cutoff: typing.SupportsFloat | typing.SupportsIndex | None = ..., softness: typing.SupportsFloat | typing.SupportsIndex | None = ..., exponent: typing.SupportsFloat | typing.SupportsIndex | None = ..., ambient: numpy.typing.ArrayLike | None = ..., diffuse: numpy.typing.ArrayLike | None = ..., specular: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsLight: ...
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsCamera:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    mode: _Attribute[mjtCamLight, typing.SupportsInt | typing.SupportsIndex]
    resolution: _Attribute[numpy.typing.NDArray[numpy.int32], numpy.typing.ArrayLike]
    output: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    fovy: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    intrinsic: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    sensor_size: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    focal_pixel: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    principal_pixel: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    userdata: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsCompiler:
    degree: _Attribute[bool, bool]
    discardvisual: _Attribute[bool, bool]
    inertiafromgeom: _Attribute[mjtInertiaFromGeom, typing.SupportsInt | typing.SupportsIndex]
    meshdir: _Attribute[str, str]
    texturedir: _Attribute[str, str]

class MjsDefault:
    joint: _Attribute[MjsJoint, MjsJoint]
    geom: _Attribute[MjsGeom, MjsGeom]
    site: _Attribute[MjsSite, MjsSite]
    camera: _Attribute[MjsCamera, MjsCamera]
    light: _Attribute[MjsLight, MjsLight]
    flex: _Attribute[MjsFlex, MjsFlex]
    mesh: _Attribute[MjsMesh, MjsMesh]
    material: _Attribute[MjsMaterial, MjsMaterial]
    pair: _Attribute[MjsPair, MjsPair]
    equality: _Attribute[MjsEquality, MjsEquality]
    tendon: _Attribute[MjsTendon, MjsTendon]
    actuator: _Attribute[MjsActuator, MjsActuator]
    name: _Attribute[str, str]

class MjsEquality:
    type: _Attribute[mjtEq, typing.SupportsInt | typing.SupportsIndex]
    data: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    active: _Attribute[bool, bool]
    objtype: _Attribute[mjtObj, typing.SupportsInt | typing.SupportsIndex]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsExclude:
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsFlex:
    contype: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    conaffinity: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    condim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    priority: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    margin: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    gap: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    dim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    radius: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    passive: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    material: _Attribute[MjStringVec, object]
    poisson: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    damping: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    thickness: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    section: _Attribute[mjtFlexSection, typing.SupportsInt | typing.SupportsIndex]
    order: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    node: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsFrame:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    scale: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    scaling: _Attribute[mjtScaling, typing.SupportsInt | typing.SupportsIndex]
    info: _Attribute[str, str]
    def add_body(self, default: MjsDefault | None = ..., name: str | None = ..., childclass: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., mass: typing.SupportsFloat | typing.SupportsIndex | None = ..., ipos: numpy.typing.ArrayLike | None = ..., iquat: numpy.typing.ArrayLike | None = ..., inertia: numpy.typing.ArrayLike | None = ..., iaxisangle: numpy.typing.ArrayLike | None = ..., ixyaxes: numpy.typing.ArrayLike | None = ..., izaxis: numpy.typing.ArrayLike | None = ..., ieuler: numpy.typing.ArrayLike | None = ..., fullinertia: numpy.typing.ArrayLike | None = ..., mocap: typing.SupportsInt | typing.SupportsIndex | None = ..., gravcomp: typing.SupportsFloat | typing.SupportsIndex | None = ..., sleep: typing.SupportsInt | typing.SupportsIndex | None = ..., simple: typing.SupportsInt | typing.SupportsIndex | None = ..., fuse: typing.SupportsInt | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., explicitinertial: typing.SupportsInt | typing.SupportsIndex | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsBody: ...
    def add_site(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., fromto: numpy.typing.ArrayLike | None = ..., size: object | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., material: str | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., rgba: numpy.typing.ArrayLike | None = ..., meshname: str | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsSite: ...
    def add_geom(self, default: MjsDefault | None = ..., name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., fromto: numpy.typing.ArrayLike | None = ..., size: object | None = ..., contype: typing.SupportsInt | typing.SupportsIndex | None = ..., conaffinity: typing.SupportsInt | typing.SupportsIndex | None = ..., condim: typing.SupportsInt | typing.SupportsIndex | None = ..., priority: typing.SupportsInt | typing.SupportsIndex | None = ..., friction: numpy.typing.ArrayLike | None = ..., solmix: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref: numpy.typing.ArrayLike | None = ..., solimp: numpy.typing.ArrayLike | None = ..., margin: typing.SupportsFloat | typing.SupportsIndex | None = ..., gap: typing.SupportsFloat | typing.SupportsIndex | None = ..., surfacevel: numpy.typing.ArrayLike | None = ..., adhesion: typing.SupportsFloat | typing.SupportsIndex | None = ..., mass: typing.SupportsFloat | typing.SupportsIndex | None = ..., density: typing.SupportsFloat | typing.SupportsIndex | None = ..., typeinertia: typing.SupportsInt | typing.SupportsIndex | None = ..., fluid_ellipsoid: typing.SupportsInt | typing.SupportsIndex | None = ..., fluid_coefs: numpy.typing.ArrayLike | None = ..., material: str | None = ..., rgba: numpy.typing.ArrayLike | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., castshadow: typing.SupportsInt | typing.SupportsIndex | None = ..., hfieldname: str | None = ..., meshname: str | None = ..., fitscale: typing.SupportsFloat | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., plugin: MjsPlugin | None = ..., info: str | None = ...) -> MjsGeom: ...
    def add_joint(self, default: MjsDefault | None = ..., name: str | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., pos: numpy.typing.ArrayLike | None = ..., axis: numpy.typing.ArrayLike | None = ..., ref: typing.SupportsFloat | typing.SupportsIndex | None = ..., align: typing.SupportsInt | typing.SupportsIndex | None = ..., stiffness: object | None = ..., springref: typing.SupportsFloat | typing.SupportsIndex | None = ..., springyield: typing.SupportsFloat | typing.SupportsIndex | None = ..., springdamper: numpy.typing.ArrayLike | None = ..., limited: typing.SupportsInt | typing.SupportsIndex | None = ..., range: numpy.typing.ArrayLike | None = ..., margin: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref_limit: numpy.typing.ArrayLike | None = ..., solimp_limit: numpy.typing.ArrayLike | None = ..., actfrclimited: typing.SupportsInt | typing.SupportsIndex | None = ..., actfrcrange: numpy.typing.ArrayLike | None = ..., armature: typing.SupportsFloat | typing.SupportsIndex | None = ..., damping: object | None = ..., frictionloss: typing.SupportsFloat | typing.SupportsIndex | None = ..., solref_friction: numpy.typing.ArrayLike | None = ..., solimp_friction: numpy.typing.ArrayLike | None = ..., group: typing.SupportsInt | typing.SupportsIndex | None = ..., actgravcomp: typing.SupportsInt | typing.SupportsIndex | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsJoint: ...
    def add_camera(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., quat: numpy.typing.ArrayLike | None = ..., axisangle: numpy.typing.ArrayLike | None = ..., xyaxes: numpy.typing.ArrayLike | None = ..., zaxis: numpy.typing.ArrayLike | None = ..., euler: numpy.typing.ArrayLike | None = ..., mode: typing.SupportsInt | typing.SupportsIndex | None = ..., targetbody: str | None = ..., proj: typing.SupportsInt | typing.SupportsIndex | None = ..., resolution: numpy.typing.ArrayLike | None = ..., output: typing.SupportsInt | typing.SupportsIndex | None = ..., fovy: typing.SupportsFloat | typing.SupportsIndex | None = ..., ipd: typing.SupportsFloat | typing.SupportsIndex | None = ..., intrinsic: numpy.typing.ArrayLike | None = ..., sensor_size: numpy.typing.ArrayLike | None = ..., focal_length: numpy.typing.ArrayLike | None = ..., focal_pixel: numpy.typing.ArrayLike | None = ..., principal_length: numpy.typing.ArrayLike | None = ..., principal_pixel: numpy.typing.ArrayLike | None = ..., userdata: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsCamera: ...
    def add_light(self, default: MjsDefault | None = ..., name: str | None = ..., pos: numpy.typing.ArrayLike | None = ..., dir: numpy.typing.ArrayLike | None = ..., mode: typing.SupportsInt | typing.SupportsIndex | None = ..., targetbody: str | None = ..., active: typing.SupportsInt | typing.SupportsIndex | None = ..., type: typing.SupportsInt | typing.SupportsIndex | None = ..., texture: str | None = ..., castshadow: typing.SupportsInt | typing.SupportsIndex | None = ..., bulbradius: typing.SupportsFloat | typing.SupportsIndex | None = ..., intensity: typing.SupportsFloat | typing.SupportsIndex | None = ..., range: typing.SupportsFloat | typing.SupportsIndex | None = ..., attenuation: numpy.typing.ArrayLike | None = ..., cutoff: typing.SupportsFloat | typing.SupportsIndex | None = ..., softness: typing.SupportsFloat | typing.SupportsIndex | None = ..., exponent: typing.SupportsFloat | typing.SupportsIndex | None = ..., ambient: numpy.typing.ArrayLike | None = ..., diffuse: numpy.typing.ArrayLike | None = ..., specular: numpy.typing.ArrayLike | None = ..., info: str | None = ...) -> MjsLight: ...
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsGeom:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    type: _Attribute[mjtGeom, typing.SupportsInt | typing.SupportsIndex]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    fromto: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    contype: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    conaffinity: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    condim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    priority: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    margin: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    gap: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    mass: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    density: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    material: _Attribute[str, str]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    castshadow: _Attribute[bool, bool]
    meshname: _Attribute[str, str]
    userdata: _Attribute[MjDoubleVec, object]
    plugin: _Attribute[MjsPlugin, MjsPlugin]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsHField:
    file: _Attribute[str, str]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    userdata: _Attribute[MjFloatVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsJoint:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    type: _Attribute[mjtJoint, typing.SupportsInt | typing.SupportsIndex]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    axis: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    ref: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    align: _Attribute[mjtAlignFree, typing.SupportsInt | typing.SupportsIndex]
    stiffness: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    springref: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    limited: _Attribute[mjtLimited, typing.SupportsInt | typing.SupportsIndex]
    range: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    margin: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    solref_limit: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solimp_limit: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    armature: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    damping: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    frictionloss: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    solref_friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solimp_friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    userdata: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsKey:
    time: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    qpos: _Attribute[MjDoubleVec, object]
    qvel: _Attribute[MjDoubleVec, object]
    act: _Attribute[MjDoubleVec, object]
    ctrl: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsLight:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    dir: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    mode: _Attribute[mjtCamLight, typing.SupportsInt | typing.SupportsIndex]
    active: _Attribute[bool, bool]
    type: _Attribute[mjtLightType, typing.SupportsInt | typing.SupportsIndex]
    castshadow: _Attribute[bool, bool]
    range: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    cutoff: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    exponent: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    ambient: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    diffuse: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    specular: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsMaterial:
    textures: _Attribute[MjStringVec, object]
    specular: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    shininess: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsMesh:
    file: _Attribute[str, str]
    scale: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    inertia: _Attribute[mjtMeshInertia, typing.SupportsInt | typing.SupportsIndex]
    uservert: _Attribute[MjFloatVec, object]
    userface: _Attribute[MjIntVec, object]
    plugin: _Attribute[MjsPlugin, MjsPlugin]
    material: _Attribute[str, str]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsNumeric:
    data: _Attribute[MjDoubleVec, object]
    size: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsPair:
    geomname1: _Attribute[str, str]
    geomname2: _Attribute[str, str]
    condim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solreffriction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    margin: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    gap: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsPlugin:
    id: _Attribute[int, MjsPlugin]
    config: _Attribute[dict, dict]
    name: _Attribute[str, str]
    active: _Attribute[bool, bool]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsSensor:
    type: _Attribute[mjtSensor, typing.SupportsInt | typing.SupportsIndex]
    objtype: _Attribute[mjtObj, typing.SupportsInt | typing.SupportsIndex]
    objname: _Attribute[str, str]
    needstage: _Attribute[mjtStage, typing.SupportsInt | typing.SupportsIndex]
    dim: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    cutoff: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    noise: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    nsample: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    interp: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    delay: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    interval: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    userdata: _Attribute[MjDoubleVec, object]
    plugin: _Attribute[MjsPlugin, MjsPlugin]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsSite:
    parent: _Attribute[MjsBody, typing.Never]
    frame: _Attribute[MjsFrame, typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    fromto: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    type: _Attribute[mjtGeom, typing.SupportsInt | typing.SupportsIndex]
    material: _Attribute[str, str]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    meshname: _Attribute[str, str]
    userdata: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsSkin:
    file: _Attribute[str, str]
    material: _Attribute[str, str]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    face: _Attribute[MjIntVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsTendon:
    def default(self) -> MjsDefault: ...
    path: _Attribute[MjsTendonPath, typing.Never]
    stiffness: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    damping: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    frictionloss: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    solref_friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solimp_friction: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    armature: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    limited: _Attribute[mjtLimited, typing.SupportsInt | typing.SupportsIndex]
    range: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    margin: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    solref_limit: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    solimp_limit: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    material: _Attribute[str, str]
    width: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], numpy.typing.ArrayLike]
    group: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    userdata: _Attribute[MjDoubleVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsTendonPath:
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> MjsWrap: ...
    def __len__(self) -> int: ...

class MjsText:
    data: _Attribute[str, str]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsTexture:
    type: _Attribute[mjtTexture, typing.SupportsInt | typing.SupportsIndex]
    builtin: _Attribute[mjtBuiltin, typing.SupportsInt | typing.SupportsIndex]
    mark: _Attribute[mjtMark, typing.SupportsInt | typing.SupportsIndex]
    random: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    height: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    width: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    file: _Attribute[str, str]
    data: _Attribute[bytes, bytes]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsTuple:
    objtype: _Attribute[MjIntVec, object]
    objname: _Attribute[MjStringVec, object]
    info: _Attribute[str, str]
    signature: _Attribute[int, typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, str]
    compiler: _Attribute[MjsCompiler, typing.Never]

class MjsWrap:
    target: _Attribute[object, typing.Never]
    coef: _Attribute[object, typing.Never]
    type: _Attribute[mjtWrap, typing.SupportsInt | typing.SupportsIndex]
    info: _Attribute[str, str]

class MjvCamera:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjvCamera: ...
    type: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    fixedcamid: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    distance: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    azimuth: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]

class MjvOption:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjvOption: ...
    label: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    frame: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    geomgroup: _Attribute[numpy.typing.NDArray[numpy.uint8], object]
    flags: _Attribute[numpy.typing.NDArray[numpy.uint8], object]

class MjvPerturb:
    def __init__(self) -> None: ...
    def __copy__(self) -> MjvPerturb: ...
    select: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    active: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    scale: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]

class MjvScene:
    @typing.overload
    def __init__(self) -> None: ...
    @typing.overload
    def __init__(self, model: MjModel, maxgeom: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __copy__(self) -> MjvScene: ...
    maxgeom: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    ngeom: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    nflex: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    scale: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    status: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    geoms: _Attribute[tuple, typing.Never]
    lights: _Attribute[tuple, typing.Never]
    camera: _Attribute[tuple, typing.Never]
    translate: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    rotate: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    flags: _Attribute[numpy.typing.NDArray[numpy.uint8], object]

class _MjContactList:
    @typing.overload
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> MjContact: ...
    @typing.overload
    def __getitem__(self, arg0: slice) -> _MjContactList: ...
    def __len__(self) -> int: ...
    dist: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    frame: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    solreffriction: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    mu: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    H: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    dim: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    geom1: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    geom2: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    exclude: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    geom: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]
    flex: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]

class _MjDataActuatorViews:
    ctrl: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    length: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    velocity: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    force: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    moment: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataBodyViews:
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ximat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataCameraViews:
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataGeomViews:
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataJointViews:
    qpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qvel: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qacc_warmstart: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_applied: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qacc: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xanchor: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xaxis: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_bias: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_actuator: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qfrc_inverse: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataLightViews:
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataSensorViews:
    data: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataSiteViews:
    xpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    xmat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjDataTendonViews:
    length: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    velocity: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelActuatorViews:
    trntype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    dyntype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    gaintype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    biastype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    group: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    ctrllimited: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    forcelimited: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    dynprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    gainprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    biasprm: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ctrlrange: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    forcerange: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    gear: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelBodyViews:
    dofadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ipos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    mass: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    inertia: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelCameraViews:
    mode: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    fovy: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelEqualityViews:
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    data: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelExcludeViews:
    signature: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelGeomViews:
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    contype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    conaffinity: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    condim: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    group: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    priority: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    castshadow: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    margin: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    gap: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelJointViews:
    qpos0: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qpos_spring: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    qposadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    dofadr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    group: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    limited: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    axis: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    stiffness: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    range: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    margin: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    frictionloss: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    armature: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    damping: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelKeyframeViews:
    time: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qpos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    qvel: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    act: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    ctrl: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelLightViews:
    mode: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    castshadow: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    active: _Attribute[numpy.typing.NDArray[numpy.bool], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    dir: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    cutoff: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    exponent: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    ambient: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    diffuse: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    specular: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelMaterialViews:
    specular: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    shininess: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelMeshViews:
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelPairViews:
    dim: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom1: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    geom2: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    signature: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    solref: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    margin: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    gap: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    friction: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelSensorViews:
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    needstage: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    objtype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    objid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    dim: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    adr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    cutoff: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    noise: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelSiteViews:
    type: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    group: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    size: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    pos: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    quat: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    user: _Attribute[numpy.typing.NDArray[numpy.float64], object]
    rgba: _Attribute[numpy.typing.NDArray[numpy.float32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelTendonViews:
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjModelTupleViews:
    adr: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    size: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    objtype: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    objid: _Attribute[numpy.typing.NDArray[numpy.int32], object]
    id: _Attribute[int, typing.Never]
    name: _Attribute[str, typing.Never]

class _MjSolverStatList:
    @typing.overload
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> MjSolverStat: ...
    @typing.overload
    def __getitem__(self, arg0: slice) -> _MjSolverStatList: ...
    def __len__(self) -> int: ...
    gradient: _Attribute[numpy.typing.NDArray[numpy.float64], typing.Never]

class _MjWarningStatList:
    @typing.overload
    def __getitem__(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> MjWarningStat: ...
    @typing.overload
    def __getitem__(self, arg0: mjtWarning) -> MjWarningStat: ...
    @typing.overload
    def __getitem__(self, arg0: slice) -> _MjWarningStatList: ...
    def __len__(self) -> int: ...
    number: _Attribute[numpy.typing.NDArray[numpy.int32], typing.Never]

class _SpecMjOption:
    timestep: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    impratio: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    tolerance: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    gravity: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]
    density: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    viscosity: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    integrator: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    cone: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    jacobian: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    solver: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    iterations: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    disableflags: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]
    enableflags: _Attribute[int, typing.SupportsInt | typing.SupportsIndex]

class _SpecMjStatistic:
    extent: _Attribute[float, typing.SupportsFloat | typing.SupportsIndex]
    center: _Attribute[numpy.typing.NDArray[numpy.float64], numpy.typing.ArrayLike]

class _SpecMjVisual:
    global_: _Attribute[MjVisual.Global, MjVisual.Global]
    quality: _Attribute[MjVisual.Quality, MjVisual.Quality]
    headlight: _Attribute[MjVisualHeadlight, MjVisualHeadlight]
    map: _Attribute[MjVisual.Map, MjVisual.Map]
    scale: _Attribute[MjVisual.Scale, MjVisual.Scale]
    rgba: _Attribute[MjVisualRgba, MjVisualRgba]

def mj_camlight(m: MjModel, d: MjData) -> None: ...
def mj_contactForce(m: MjModel, d: MjData, id: typing.SupportsInt | typing.SupportsIndex, result: numpy.typing.NDArray[numpy.float64]) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_fullM(m: MjModel, d: MjData, dst: numpy.typing.NDArray[numpy.float64]) -> None: ...
def mj_fwdPosition(m: MjModel, d: MjData) -> None: ...
def mj_fwdVelocity(m: MjModel, d: MjData) -> None: ...
def mj_geomDistance(m: MjModel, d: MjData, geom1: typing.SupportsInt | typing.SupportsIndex, geom2: typing.SupportsInt | typing.SupportsIndex, distmax: typing.SupportsFloat | typing.SupportsIndex, fromto: numpy.typing.NDArray[numpy.float64] | None) -> float: ...
def mj_getState(m: MjModel, d: MjData, state: numpy.typing.NDArray[numpy.float64], sig: typing.SupportsInt | typing.SupportsIndex) -> None: ...
def mj_inverse(m: MjModel, d: MjData) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_name2id(m: MjModel, type: typing.SupportsInt | typing.SupportsIndex, name: str) -> int: ...
def mj_ray(m: MjModel, d: MjData, pnt: numpy.typing.ArrayLike, vec: numpy.typing.ArrayLike, geomgroup: numpy.typing.ArrayLike | None, flg_static: bool, bodyexclude: typing.SupportsInt | typing.SupportsIndex, geomid: numpy.typing.NDArray[numpy.int32] | None, normal: numpy.typing.NDArray[numpy.float64] | None = ...) -> float: ...
def mj_resetData(m: MjModel, d: MjData) -> None: ...
def mj_setConst(m: MjModel, d: MjData) -> None: ...
def mj_stateSize(m: MjModel, sig: typing.SupportsInt | typing.SupportsIndex) -> int: ...
def mj_step(m: MjModel, d: MjData, nstep: typing.SupportsInt | typing.SupportsIndex = ...) -> None: ...
def mj_versionString() -> str: ...
def mjr_readPixels(rgb: typing.Annotated[numpy.typing.ArrayLike, numpy.uint8] | None, depth: typing.Annotated[numpy.typing.ArrayLike, numpy.float32] | None, viewport: MjrRect, con: MjrContext) -> None: ...
def mjr_render(viewport: MjrRect, scn: MjvScene, con: MjrContext) -> None: ...
def mjr_setBuffer(framebuffer: typing.SupportsInt | typing.SupportsIndex, con: MjrContext) -> None: ...
class mjtActuator(_Enum):
    ...

class mjtAlignFree(_Enum):
    ...

class mjtBias(_Enum):
    mjBIAS_NONE: typing.ClassVar[mjtBias]
    mjBIAS_AFFINE: typing.ClassVar[mjtBias]

class mjtBuiltin(_Enum):
    ...

class mjtCamLight(_Enum):
    ...

class mjtCamera(_Enum):
    mjCAMERA_FIXED: typing.ClassVar[mjtCamera]

class mjtCatBit(_Enum):
    mjCAT_ALL: typing.ClassVar[mjtCatBit]

class mjtCone(_Enum):
    mjCONE_ELLIPTIC: typing.ClassVar[mjtCone]

class mjtConstraint(_Enum):
    mjCNSTR_FRICTION_DOF: typing.ClassVar[mjtConstraint]

class mjtCtrlInput(_Enum):
    mjINPUT_NONE: typing.ClassVar[mjtCtrlInput]

class mjtDisableBit(_Enum):
    mjDSBL_CONSTRAINT: typing.ClassVar[mjtDisableBit]
    mjDSBL_FRICTIONLOSS: typing.ClassVar[mjtDisableBit]
    mjDSBL_CONTACT: typing.ClassVar[mjtDisableBit]
    mjDSBL_SPRING: typing.ClassVar[mjtDisableBit]
    mjDSBL_DAMPER: typing.ClassVar[mjtDisableBit]
    mjDSBL_GRAVITY: typing.ClassVar[mjtDisableBit]
    mjDSBL_ACTUATION: typing.ClassVar[mjtDisableBit]
    mjDSBL_ISLAND: typing.ClassVar[mjtDisableBit]

class mjtDyn(_Enum):
    mjDYN_NONE: typing.ClassVar[mjtDyn]
    mjDYN_FILTEREXACT: typing.ClassVar[mjtDyn]

class mjtEnableBit(_Enum):
    mjENBL_INVDISCRETE: typing.ClassVar[mjtEnableBit]

class mjtEq(_Enum):
    mjEQ_CONNECT: typing.ClassVar[mjtEq]
    mjEQ_WELD: typing.ClassVar[mjtEq]
    mjEQ_JOINT: typing.ClassVar[mjtEq]
    mjEQ_TENDON: typing.ClassVar[mjtEq]

class mjtFlexSection(_Enum):
    ...

class mjtFontScale(_Enum):
    mjFONTSCALE_100: typing.ClassVar[mjtFontScale]

class mjtFramebuffer(_Enum):
    mjFB_OFFSCREEN: typing.ClassVar[mjtFramebuffer]

class mjtGain(_Enum):
    mjGAIN_FIXED: typing.ClassVar[mjtGain]
    mjGAIN_AFFINE: typing.ClassVar[mjtGain]

class mjtGeom(_Enum):
    mjGEOM_PLANE: typing.ClassVar[mjtGeom]
    mjGEOM_SPHERE: typing.ClassVar[mjtGeom]
    mjGEOM_CAPSULE: typing.ClassVar[mjtGeom]
    mjGEOM_CYLINDER: typing.ClassVar[mjtGeom]
    mjGEOM_BOX: typing.ClassVar[mjtGeom]
    mjGEOM_MESH: typing.ClassVar[mjtGeom]

class mjtInertiaFromGeom(_Enum):
    ...

class mjtIntegrator(_Enum):
    mjINT_EULER: typing.ClassVar[mjtIntegrator]
    mjINT_IMPLICITFAST: typing.ClassVar[mjtIntegrator]

class mjtJoint(_Enum):
    mjJNT_FREE: typing.ClassVar[mjtJoint]
    mjJNT_SLIDE: typing.ClassVar[mjtJoint]
    mjJNT_HINGE: typing.ClassVar[mjtJoint]

class mjtLightType(_Enum):
    mjLIGHT_DIRECTIONAL: typing.ClassVar[mjtLightType]

class mjtLimited(_Enum):
    mjLIMITED_TRUE: typing.ClassVar[mjtLimited]

class mjtMark(_Enum):
    ...

class mjtMeshInertia(_Enum):
    mjMESH_INERTIA_SHELL: typing.ClassVar[mjtMeshInertia]

class mjtObj(_Enum):
    mjOBJ_BODY: typing.ClassVar[mjtObj]
    mjOBJ_JOINT: typing.ClassVar[mjtObj]
    mjOBJ_GEOM: typing.ClassVar[mjtObj]
    mjOBJ_SITE: typing.ClassVar[mjtObj]
    mjOBJ_PAIR: typing.ClassVar[mjtObj]
    mjOBJ_ACTUATOR: typing.ClassVar[mjtObj]

class mjtRndFlag(_Enum):
    mjRND_SHADOW: typing.ClassVar[mjtRndFlag]
    mjRND_REFLECTION: typing.ClassVar[mjtRndFlag]
    mjRND_SKYBOX: typing.ClassVar[mjtRndFlag]
    mjRND_SEGMENT: typing.ClassVar[mjtRndFlag]
    mjRND_IDCOLOR: typing.ClassVar[mjtRndFlag]

class mjtScaling(_Enum):
    ...

class mjtSensor(_Enum):
    mjSENS_TOUCH: typing.ClassVar[mjtSensor]
    mjSENS_USER: typing.ClassVar[mjtSensor]

class mjtSleepPolicy(_Enum):
    ...

class mjtStage(_Enum):
    mjSTAGE_NONE: typing.ClassVar[mjtStage]
    mjSTAGE_POS: typing.ClassVar[mjtStage]

class mjtState(_Enum):
    mjSTATE_QFRC_APPLIED: typing.ClassVar[mjtState]
    mjSTATE_FULLPHYSICS: typing.ClassVar[mjtState]

class mjtTexture(_Enum):
    ...

class mjtTrn(_Enum):
    mjTRN_JOINT: typing.ClassVar[mjtTrn]
    mjTRN_JOINTINPARENT: typing.ClassVar[mjtTrn]

class mjtWarning(_Enum):
    ...

class mjtWrap(_Enum):
    mjWRAP_JOINT: typing.ClassVar[mjtWrap]
    mjWRAP_SITE: typing.ClassVar[mjtWrap]

def mju_mat2Quat(quat: numpy.typing.NDArray[numpy.float64], mat: numpy.typing.ArrayLike) -> None: ...
def mju_quat2Mat(res: numpy.typing.NDArray[numpy.float64], quat: numpy.typing.ArrayLike) -> None: ...
def mju_quatIntegrate(quat: numpy.typing.NDArray[numpy.float64], vel: numpy.typing.ArrayLike, scale: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
def mju_subQuat(res: numpy.typing.NDArray[numpy.float64], qa: numpy.typing.ArrayLike, qb: numpy.typing.ArrayLike) -> None: ...
def mjv_updateScene(m: MjModel, d: MjData, opt: MjvOption, pert: MjvPerturb | None, cam: MjvCamera, catmask: typing.SupportsInt | typing.SupportsIndex, scn: MjvScene) -> None: ...
def set_mjcb_control(arg0: object) -> None: ...
def set_mjcb_time(arg0: object) -> None: ...
def set_mju_user_warning(arg0: object) -> None: ...
