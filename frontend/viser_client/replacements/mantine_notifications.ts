// The page around the frame shows what has happened; the scene has no notifications.
export const Notifications = () => null;
export const notifications = { show() {}, update() {}, hide() {} };
