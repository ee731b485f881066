// A robot that is not ours: Fast DDS, type support generated from camera.idl. Sends what tests/robots/ros_camera.py sends in form
// "raw", twenty times a second: images best effort, CameraInfo and /tf_static once, for those who come later, too.
// usage: peer DOMAIN IMAGES
#include "cameraPubSubTypes.h"
#include <chrono>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <iostream>
#include <thread>

using namespace eprosima::fastdds::dds;
using Header = std_msgs::msg::dds_::Header_;
using Image = sensor_msgs::msg::dds_::Image_;
using Info = sensor_msgs::msg::dds_::CameraInfo_;
using Stamped = geometry_msgs::msg::dds_::TransformStamped_;
using Transforms = tf2_msgs::msg::dds_::TFMessage_;
const int WIDTH = 64, HEIGHT = 48;
const char* FRAME = "camera_optical";

Header at(int k, const char* frame) {
  Header header;
  header.stamp().sec(1700000000 + k / 10);
  header.stamp().nanosec(k % 10 * 100000000u);
  header.frame_id(frame);
  return header;
}

Stamped moved(int k, const char* parent, const char* child, double x, double y, double z, double qx, double qy, double qz, double qw) {
  Stamped out;
  out.header(at(k, parent));
  out.child_frame_id(child);
  auto& t = out.transform().translation();
  auto& q = out.transform().rotation();
  t.x(x), t.y(y), t.z(z), q.x(qx), q.y(qy), q.z(qz), q.w(qw);
  return out;
}

int main(int, char** argv) {
  DomainParticipantQos qos;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(std::atoi(argv[1]), qos);
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto writer = [&](TypeSupport type, const char* name, bool reliable, bool latched) {
    type.register_type(participant);
    Topic* topic = participant->create_topic(std::string("rt/") + name, type.get_type_name(), TOPIC_QOS_DEFAULT);
    DataWriterQos writer_qos = DATAWRITER_QOS_DEFAULT;
    writer_qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    writer_qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    writer_qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
    return publisher->create_datawriter(topic, writer_qos);
  };
  TypeSupport image(new sensor_msgs::msg::dds_::Image_PubSubType()), info(new sensor_msgs::msg::dds_::CameraInfo_PubSubType()),
      tf(new tf2_msgs::msg::dds_::TFMessage_PubSubType());
  auto *colour = writer(image, "camera/color/image_raw", false, false), *depth = writer(image, "camera/depth/image_raw", false, false),
       *lens = writer(info, "camera/color/camera_info", true, true), *moving = writer(tf, "tf", true, false),
       *fixed = writer(tf, "tf_static", true, true);
  Info about;
  about.header(at(0, FRAME));
  about.height(HEIGHT), about.width(WIDTH), about.distortion_model("plumb_bob"), about.d({0, 0, 0, 0, 0});
  about.k({60, 0, 32, 0, 60, 24, 0, 0, 1});
  about.r({1, 0, 0, 0, 1, 0, 0, 0, 1});
  about.p({60, 0, 32, 0, 0, 60, 24, 0, 0, 0, 1, 0});
  lens->write(&about);
  Transforms still;
  still.transforms({moved(0, "map", "odom", 1, 2, 0, 0, 0, 0, 1), moved(0, "base", FRAME, 0.1, 0, 1.2, -0.5, 0.5, -0.5, 0.5)});
  fixed->write(&still);
  std::cout << "ready" << std::endl;
  for (int k = 0; k < std::atoi(argv[2]); ++k) {
    Transforms drive;
    drive.transforms({moved(k, "odom", "base", 0.1 * k, 0, 0, 0, 0, 0, 1)});
    moving->write(&drive);
    Image rgb, mm;
    rgb.header(at(k, FRAME)), mm.header(at(k, FRAME));
    rgb.height(HEIGHT), rgb.width(WIDTH), rgb.encoding("rgb8"), rgb.step(WIDTH * 3);
    mm.height(HEIGHT), mm.width(WIDTH), mm.encoding("16UC1"), mm.step(WIDTH * 2);
    for (int y = 0; y < HEIGHT; ++y)
      for (int x = 0; x < WIDTH; ++x) {
        for (int value : {x * 4, y * 5, 77}) rgb.data().push_back(static_cast<uint8_t>(value));
        const int far = 1000 + 10 * x + y;
        mm.data().push_back(far & 255), mm.data().push_back(far >> 8);
      }
    colour->write(&rgb);
    depth->write(&mm);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  std::_Exit(0);
}
